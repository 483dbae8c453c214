"""Integral images of one row: sums over octagons, by what each gains from one row to the next.

The octagon (m, n) has horizontal and vertical sides of m pixels and slanted sides of n rows, so it
is m + 2 n pixels wide and high. (m, 0) is a square and (1, n) a diamond. Moved down by a pixel, it
gains its lower boundary and loses the pixels above its upper one: a slanted, a horizontal and
again a slanted run of pixels each. Sums of such runs are differences of sums along rows and
diagonals, which fit into 16 bits, where those of whole octagons do not. So twice as many are
added at once, and the rows in use stay in the cache.

Source: slanted integral images of Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas
for Realtime Feature Detection and Matching, ECCV 2008, section 3.2.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

KEPT_ROWS = 64
"""Number of rows whose running sums are kept, a power of two."""

MAX_REACH = 21
"""Largest half width of an octagon, pixels: KEPT_ROWS hold its height and the row above."""

PAD = MAX_REACH + 2
"""Columns beside the image in tables of running sums, as black pixels."""

FALLING, RISING, LEFT, RIGHT = range(4)
"""Tables of running sums, see `append_row`."""


def boundary(m: int, n: int) -> list[tuple[int, int, int]]:
    """List (table, rows, columns) from the centre of what an octagon gains by a step to its row.

    The entries 2 to 5 count negative. The first four are those of the lower boundary, the last
    four those of the upper one.
    """
    inner, outer = m // 2, m // 2 + n
    return [
        (LEFT, outer, -inner),
        (RIGHT, outer, inner + 1),
        (FALLING, inner - 1, -outer - 1),
        (RISING, inner - 1, outer + 1),
        (RISING, -inner - 1, -outer),
        (FALLING, -inner - 1, outer),
        (LEFT, -outer - 1, inner),
        (RIGHT, -outer - 1, 1 - inner),
    ]


def locate(corners: Array, columns: int) -> Array:
    """Find where corners (P, 8, 3) from `boundary` lie in flat tables of a number of columns.

    (KEPT_ROWS, P, 8) uint64, for octagons in column 0 of row v in v % KEPT_ROWS. Unsigned, for
    Numba tests signed indices for being negative, in every step of a loop.
    """
    table, down, right = np.moveaxis(corners, -1, 0)
    rows = (np.arange(KEPT_ROWS)[:, None, None] + down) % KEPT_ROWS
    return ((rows * 4 + table) * columns + PAD + right).astype(np.uint64)


@compiled(no_cpython_wrapper=True)
def append_row(image: Image, v: int, tables: Array, pixels: Array) -> None:
    """Set the running sums of a row: tables (KEPT_ROWS, 4, PAD + W + at least PAD) int16.

    With I the image, black outside, and P[v, u] the sum of row v left of column u, they are sums
    along diagonals that end at (v, u), F[v, u] = F[v - 1, u - 1] + I[v, u] and R[v, u] =
    R[v - 1, u + 1] + I[v, u], and at corners of octagons, where a diagonal meets a row,
    F[v - 1, u - 1] - P[v, u] and R[v - 1, u] + P[v, u]. What exceeds 16 bits wraps around, which
    differences undo. Must be called for each row in turn, with tables zero before the first.
    """
    for u in range(image.shape[1]):
        pixels[0, PAD + u] = image[v, u] if v < len(image) else 0
    total = np.int32(0)
    for u in range(pixels.shape[1]):
        pixels[1, u] = total
        total += np.int32(pixels[0, u])
    old, new = (v - 1) & (KEPT_ROWS - 1), v & (KEPT_ROWS - 1)
    for u in range(1, pixels.shape[1] - 1):
        pixel, sums = pixels[0, u], pixels[1, u]
        falling, rising = tables[old, FALLING, u - 1], tables[old, RISING, u + 1]
        tables[new, FALLING, u] = falling + pixel
        tables[new, RISING, u] = rising + pixel
        tables[new, LEFT, u] = falling - sums
        tables[new, RIGHT, u] = tables[old, RISING, u] + sums


@compiled(no_cpython_wrapper=True)
def add_boundaries(
    tables: Array, v: int, pieces: Array, places: Array, gained: Array, sums: Array
) -> None:
    """Move octagons with centres in a row down to row v, at all columns.

    Adds what they gain to the sums (R, W) float32. The pieces (P, 2) are rows (index into sums,
    sign), their places (KEPT_ROWS, P, 8) from `locate`; gained (W,) int16 is overwritten.
    """
    row, flat = v & (KEPT_ROWS - 1), tables.reshape(tables.size)
    for i in range(len(pieces)):
        a, b, c, d = places[row, i, 0], places[row, i, 1], places[row, i, 2], places[row, i, 3]
        e, f, g, h = places[row, i, 4], places[row, i, 5], places[row, i, 6], places[row, i, 7]
        for u in range(np.uint64(len(gained))):
            more = flat[a + u] + flat[b + u] + flat[g + u] + flat[h + u]
            gained[u] = more - flat[c + u] - flat[d + u] - flat[e + u] - flat[f + u]
        region, sign = pieces[i, 0], np.float32(pieces[i, 1])
        for u in range(len(gained)):
            sums[region, u] += sign * np.float32(gained[u])
