"""Slant of the surface at a feature, by a plane through the disparities of its neighbours.

The disparity of a plane is linear in the pixel. Few exact disparities, tens of pixels apart,
determine its slopes better than many coarse ones nearby.

Source: iteratively reweighted least squares with Geman and McClure's weights, Zhang, Parameter
Estimation Techniques, IVC 1997.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled

CELL_PX = 40.0
"""Side of the cells that pixels are sorted into; a few features lie in each."""


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
    x, y, d = np.empty_like(distance), np.empty_like(distance), np.empty_like(distance)
    first, rows = _sort_into_cells(pixels)
    for i in range(len(at)):
        here = at[i, 0], at[i, 1]
        count = _nearest(here, pixels, first, rows, near, distance)
        if count < PLANE_FIT.min_support:
            continue
        own_weight, origin = PLANE_FIT.own_weight, own[i]
        if np.isnan(origin):
            own_weight, origin = 0.0, disparity[near[0]]
        for j in range(count):
            x[j], y[j] = pixels[near[j], 0] - here[0], pixels[near[j], 1] - here[1]
            d[j] = disparity[near[j]] - origin
        support, a, b = _fit(x, y, d, count, own_weight)
        if support >= PLANE_FIT.min_support:
            slopes[i, 0], slopes[i, 1] = a, b
    return slopes


@compiled(fastmath={"reassoc", "contract"})
def _fit(x: Array, y: Array, d: Array, count: int, own_weight: float) -> tuple[float, float, float]:
    """Fit a plane to neighbours (N,) about a point on it: their weight, and the two slopes."""
    a = b = c = support = 0.0
    scale = 8.0 * PLANE_FIT.residual_px  # coarse to fine: the first plane errs by pixels
    for _ in range(PLANE_FIT.iterations):
        support = sx = sy = sd = sxx = sxy = syy = sxd = syd = 0.0
        for j in range(np.uint64(count)):
            residual = (d[j] - a * x[j] - b * y[j] - c) / scale
            root = 1 / (1 + residual * residual)
            w = root * root
            support += w
            sx, sy, sd = sx + w * x[j], sy + w * y[j], sd + w * d[j]
            sxx, sxy, syy = sxx + w * x[j] * x[j], sxy + w * x[j] * y[j], syy + w * y[j] * y[j]
            sxd, syd = sxd + w * x[j] * d[j], syd + w * y[j] * d[j]
        s = support + own_weight
        sxx, syy = sxx + PLANE_FIT.prior - sx * sx / s, syy + PLANE_FIT.prior - sy * sy / s
        sxy, sxd, syd = sxy - sx * sy / s, sxd - sx * sd / s, syd - sy * sd / s
        determinant = sxx * syy - sxy * sxy
        a = (syy * sxd - sxy * syd) / determinant
        b = (sxx * syd - sxy * sxd) / determinant
        c = (sd - a * sx - b * sy) / s
        scale = max(scale / 2, PLANE_FIT.residual_px)
    return support, a, b


@compiled()
def _sort_into_cells(pixels: Array) -> tuple[Indices, Indices]:
    """Sort pixels by square cells: where each cell begins (L, C + 1), and the rows (N,)."""
    columns = lines = 1
    for j in range(len(pixels)):
        columns = max(columns, _cell(pixels[j, 0]) + 1)
        lines = max(lines, _cell(pixels[j, 1]) + 1)
    first = np.zeros((lines, columns + 1), dtype=np.int64)
    for j in range(len(pixels)):
        first[_cell(pixels[j, 1]), _cell(pixels[j, 0]) + 1] += 1
    total = 0
    for line in range(lines):
        first[line, 0] = total
        for column in range(columns):
            total += first[line, column + 1]
            first[line, column + 1] = total
    rows, filled = np.empty(len(pixels), dtype=np.int64), first.copy()
    for j in range(len(pixels)):
        line, column = _cell(pixels[j, 1]), _cell(pixels[j, 0])
        rows[filled[line, column]] = j
        filled[line, column] += 1
    return first, rows


@compiled()
def _cell(pixel: float) -> int:
    return max(int(pixel / CELL_PX), 0)


@compiled()
def _nearest(
    at: tuple[float, float], pixels: Array, first: Indices, rows: Indices, near: Indices,
    distance: Array,
) -> int:  # fmt: skip
    """Write the rows of the nearest pixels but `at` itself, the nearest first; return their number.

    Cells are searched in rings about that of `at`, until those further out can hold no nearer one.
    """
    limit = PLANE_FIT.max_distance_px * PLANE_FIT.max_distance_px
    lines, columns = first.shape[0], first.shape[1] - 1
    line, column = _cell(at[1]), _cell(at[0])
    most, count, farthest = len(near), 0, 0
    for ring in range(int(PLANE_FIT.max_distance_px / CELL_PX) + 2):
        reached = max(ring - 1, 0) * CELL_PX  # by the rings inside this one, at least
        if count == most and limit <= reached * reached:
            break
        for y in range(max(line - ring, 0), min(line + ring + 1, lines)):
            step = 1 if abs(y - line) == ring else max(2 * ring, 1)
            for x in range(column - ring, column + ring + 1, step):
                if not 0 <= x < columns:
                    continue
                for k in range(first[y, x], first[y, x + 1]):
                    row = rows[k]
                    du, dv = pixels[row, 0] - at[0], pixels[row, 1] - at[1]
                    square = du * du + dv * dv
                    if not 0 < square < limit:
                        continue
                    place = count if count < most else farthest
                    near[place], distance[place] = row, square
                    count = min(count + 1, most)
                    if count == most:  # the next one must be nearer than the farthest
                        for j in range(most):
                            farthest = j if distance[j] > distance[farthest] else farthest
                        limit = distance[farthest]
    for j in range(1, count):
        if distance[j] < distance[0]:
            near[0], near[j] = near[j], near[0]
            distance[0], distance[j] = distance[j], distance[0]
    return count
