"""Integral images: sums over octagons at every pixel from three tables of prefix sums.

The octagon (m, n) has horizontal and vertical sides of m pixels and slanted sides of n rows, so it
is m + 2 n pixels wide and high. (m, 0) is a square and (1, n) a diamond.

Source: slanted integral images of Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas
for Realtime Feature Detection and Matching, ECCV 2008, section 3.2.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled


@compiled()
def prefix_sums(image: Image) -> Array:
    """Build three tables (3, H + 1, W + 1) int32 of the sums of all pixels above and to the left.

    With P[v, u] the sum of row v left of column u, entry (v + 1, u) adds up P downwards to row v:
    along the column (the integral image), along a falling diagonal that ends at u and moves right
    by one per row, and along a rising one that ends at u and moves left. Sums that exceed 32 bits
    wrap around, which the differences of `add_octagons` undo.
    """
    height, width = image.shape
    row = np.zeros(width + 1, dtype=np.int32)
    tables = np.empty((3, height + 1, width + 1), dtype=np.int32)
    tables[:, 0] = 0
    tables[1, :, 0] = 0
    for v in range(height):
        total = np.int32(0)
        pixels = image[v]
        sums = row[1:]
        for u in range(width):
            total += np.int32(pixels[u])
            sums[u] = total
        _add(tables[0, v], row, tables[0, v + 1])
        _add(tables[1, v, :-1], row[1:], tables[1, v + 1, 1:])
        _add(tables[2, v, 1:], row[:-1], tables[2, v + 1, :-1])
        # Beyond the image P stays the row's sum.
        tables[2, v + 1, width] = tables[0, v, width] + total
    return tables


@compiled()
def _add(a: Array, b: Array, total: Array) -> None:
    for i in range(len(total)):
        total[i] = a[i] + b[i]


@compiled()
def add_octagons(tables: Array, m: int, n: int, sign: int, v: int, u: int, sums: Array) -> None:
    """Add `sign` times the sums of the octagons of one row to `sums`.

    Their bounding squares have the upper left corner at row v and columns u, u + 1, ... Each is a
    rectangle of m rows between two trapezoids, the upper of which grows by one pixel on each side
    per row while the lower shrinks.
    """
    size = m + 2 * n
    count = len(sums)
    straight, falling, rising = tables[0], tables[1], tables[2]
    upper, lower, end = v + n, v + n + m, v + size
    left, right = u, u + size
    _add_corners(
        straight[lower, right : right + count], straight[upper, right : right + count],
        straight[lower, left : left + count], straight[upper, left : left + count], sign, sums,
    )  # fmt: skip
    if n == 0:
        return
    inner_left, inner_right = u + n, u + n + m
    _add_corners(
        falling[upper, right - 1 : right - 1 + count],
        falling[v, inner_right - 1 : inner_right - 1 + count],
        rising[upper, left + 1 : left + 1 + count],
        rising[v, inner_left + 1 : inner_left + 1 + count], sign, sums,
    )  # fmt: skip
    _add_corners(
        rising[end, inner_right : inner_right + count], rising[lower, right : right + count],
        falling[end, inner_left : inner_left + count], falling[lower, left : left + count],
        sign, sums,
    )  # fmt: skip


@compiled()
def _add_corners(a: Array, b: Array, c: Array, d: Array, sign: int, sums: Array) -> None:
    factor = np.int32(sign)
    for i in range(len(sums)):
        sums[i] += factor * (a[i] - b[i] - c[i] + d[i])
