"""Slant of the surface at a feature, by a plane through the disparities of its neighbours.

The disparity of a plane is linear in the pixel. Few exact disparities, tens of pixels apart,
determine its slopes better than many coarse ones nearby.

Source: iteratively reweighted least squares with Geman and McClure's weights, Zhang, Parameter
Estimation Techniques, IVC 1997.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled


class PlaneFit(NamedTuple):
    """Parameters of the fit of a plane (decision 4; weights after Zhang 1997).

    Attributes:
        max_distance_px: Distance beyond which neighbours lie on another surface.
        min_support: Smallest sum of the weights of the neighbours that agree with the plane.
        residual_px: Residual at which a neighbour loses three quarters of its weight.
        own_weight: Weight of the feature's own disparity: the feature lies on the plane.
        prior: Weight of a slope of zero, px²: neighbours on one line give no slope across it.
    """

    neighbours: int = 16
    max_distance_px: float = 120.0
    min_support: float = 4.0
    residual_px: float = 0.5
    own_weight: float = 2.0
    iterations: int = 5
    prior: float = 1.0


PLANE_FIT = PlaneFit()
"""Parameters of every fit."""


def fit_plane_slopes(
    at: Array, at_disparity_px: Array, pixels: Array, disparity_px: Array
) -> Array:
    """Fit planes about pixels (M, 2) of the left image: (M, 2) change of disparity along u and v.

    Zero, a surface that faces the camera, where too few neighbours lie on one plane with the pixel.
    The neighbours are of (N, 2) pixels with disparities (N,), those of `at` included or not;
    disparities may be NaN. Where one of `at` (M,) is, the neighbours alone count.
    """
    known = np.isfinite(disparity_px)
    given = at, at_disparity_px, pixels[known], disparity_px[known]
    return _fit_all(*(np.ascontiguousarray(x, dtype=np.float64) for x in given))


@compiled()
def _fit_all(at: Array, own: Array, pixels: Array, disparity: Array) -> Array:
    slopes = np.zeros((len(at), 2))
    near = np.empty(PLANE_FIT.neighbours, dtype=np.int64)
    distance = np.empty(PLANE_FIT.neighbours)
    for i in range(len(at)):
        count = _nearest(at[i], pixels, near, distance)
        if count < PLANE_FIT.min_support:
            continue
        own_weight, origin = PLANE_FIT.own_weight, own[i]
        if np.isnan(origin):
            own_weight, origin = 0.0, disparity[near[0]]
        a = b = c = support = 0.0
        scale = 8.0 * PLANE_FIT.residual_px  # coarse to fine: the first plane errs by pixels
        for _ in range(PLANE_FIT.iterations):
            support, s, sx, sy = 0.0, own_weight, 0.0, 0.0
            sxx, sxy, syy = PLANE_FIT.prior, 0.0, PLANE_FIT.prior
            sd, sxd, syd = 0.0, 0.0, 0.0
            for j in range(count):
                x, y = pixels[near[j], 0] - at[i, 0], pixels[near[j], 1] - at[i, 1]
                d = disparity[near[j]] - origin
                residual = (d - a * x - b * y - c) / scale
                w = 1 / (1 + residual * residual) ** 2
                support += w
                s, sx, sy, sd = s + w, sx + w * x, sy + w * y, sd + w * d
                sxx, sxy, syy = sxx + w * x * x, sxy + w * x * y, syy + w * y * y
                sxd, syd = sxd + w * x * d, syd + w * y * d
            sxx, sxy, syy = sxx - sx * sx / s, sxy - sx * sy / s, syy - sy * sy / s
            sxd, syd = sxd - sx * sd / s, syd - sy * sd / s
            determinant = sxx * syy - sxy * sxy
            a = (syy * sxd - sxy * syd) / determinant
            b = (sxx * syd - sxy * sxd) / determinant
            c = (sd - a * sx - b * sy) / s
            scale = max(scale / 2, PLANE_FIT.residual_px)
        if support >= PLANE_FIT.min_support:
            slopes[i, 0], slopes[i, 1] = a, b
    return slopes


@compiled()
def _nearest(at: Array, pixels: Array, near: Array, distance: Array) -> int:
    """Write the rows of the nearest pixels but `at` itself, nearest first; return their number."""
    max_count, reach = PLANE_FIT.neighbours, PLANE_FIT.max_distance_px
    count = 0
    for j in range(len(pixels)):
        x, y = pixels[j, 0] - at[0], pixels[j, 1] - at[1]
        square = x * x + y * y
        if not 0 < square < reach * reach:
            continue
        if count == max_count and square >= distance[count - 1]:
            continue
        k = min(count, max_count - 1)
        while k > 0 and distance[k - 1] > square:
            distance[k], near[k] = distance[k - 1], near[k - 1]
            k -= 1
        distance[k], near[k] = square, j
        count = min(count + 1, max_count)
    return count
