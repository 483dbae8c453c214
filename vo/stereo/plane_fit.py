"""Slant of the surface at a feature: a plane through the disparities of its neighbours.

The disparity of a plane is linear in the pixel. Few exact disparities, tens of pixels apart, say
more about its slopes than many coarse ones nearby.

Source: iteratively reweighted least squares with Geman and McClure's weights, Zhang, Parameter
Estimation Techniques, IVC 1997.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled

NEIGHBOURS = 16
REACH_PX = 120.0
"""Neighbours further away show another surface."""

LEAST_NEIGHBOURS = 4.0
"""Of those that agree with the plane, each counted by its weight."""

AGREE_PX = 0.5
"""Misfit at which a neighbour loses three quarters of its weight."""

OWN_WEIGHT = 2.0
"""Of the feature's own disparity: the plane is to be the one on which the feature lies."""

ROUNDS = 5

PRIOR = 1.0
"""Weight of a slope of zero, px²: no slope is derived from neighbours on one line."""


def fit_plane_slopes(
    at: Array, at_disparity_px: Array, pixels: Array, disparity_px: Array
) -> Array:
    """Fit planes about pixels of the left image.

    Args:
        at: (M, 2) pixels (u, v).
        at_disparity_px: (M,) their disparity; where it is NaN, the neighbours alone decide.
        pixels: (N, 2) pixels of which the disparity is known, those of `at` included or not.
        disparity_px: (N,) NaN where it is not known after all.

    Returns:
        (M, 2) change of disparity per pixel along u and v; zero, a surface that faces the camera,
        where too few neighbours lie on one plane with the pixel.
    """
    known = np.isfinite(disparity_px)
    slopes = np.zeros((len(at), 2))
    _fit_all(
        np.asarray(at, dtype=np.float64), np.asarray(at_disparity_px, dtype=np.float64),
        np.asarray(pixels[known], dtype=np.float64),
        np.asarray(disparity_px[known], dtype=np.float64), slopes,
    )  # fmt: skip
    return slopes


@compiled()
def _fit_all(at: Array, own: Array, pixels: Array, disparity: Array, slopes: Array) -> None:
    near = np.empty(NEIGHBOURS, dtype=np.int64)
    distance = np.empty(NEIGHBOURS)
    for i in range(len(at)):
        count = _nearest(at[i], pixels, near, distance)
        if count < LEAST_NEIGHBOURS:
            continue
        own_weight, origin = OWN_WEIGHT, own[i]
        if np.isnan(origin):
            own_weight, origin = 0.0, disparity[near[0]]
        a = b = c = support = 0.0
        scale = 8.0 * AGREE_PX  # from coarse to fine: the first plane may be wrong by pixels
        for _ in range(ROUNDS):
            support, s, sx, sy = 0.0, own_weight, 0.0, 0.0
            sxx, sxy, syy, sd, sxd, syd = PRIOR, 0.0, PRIOR, 0.0, 0.0, 0.0
            for j in range(count):
                x, y = pixels[near[j], 0] - at[i, 0], pixels[near[j], 1] - at[i, 1]
                d = disparity[near[j]] - origin
                misfit = (d - a * x - b * y - c) / scale
                w = 1 / (1 + misfit * misfit) ** 2
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
            scale = max(scale / 2, AGREE_PX)
        if support >= LEAST_NEIGHBOURS:
            slopes[i, 0], slopes[i, 1] = a, b


@compiled()
def _nearest(at: Array, pixels: Array, near: Array, distance: Array) -> int:
    """Write the indices of the nearest pixels but `at` itself, nearest first; return how many."""
    count = 0
    for j in range(len(pixels)):
        x, y = pixels[j, 0] - at[0], pixels[j, 1] - at[1]
        square = x * x + y * y
        if not 0 < square < REACH_PX * REACH_PX:
            continue
        if count == NEIGHBOURS and square >= distance[count - 1]:
            continue
        k = min(count, NEIGHBOURS - 1)
        while k > 0 and distance[k - 1] > square:
            distance[k], near[k] = distance[k - 1], near[k - 1]
            k -= 1
        distance[k], near[k] = square, j
        count = min(count + 1, NEIGHBOURS)
    return count


def left_to_right(slopes: Array) -> Array:
    """Warps (N, 3, 2) of left offsets to right ones: u_right = u_left - d(u_left, v)."""
    warp = np.tile(np.eye(3, 2), (len(slopes), 1, 1))
    warp[:, 0] -= slopes
    return warp
