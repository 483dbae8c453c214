"""ZNCC of a patch with all patches along a row of whole pixels.

Source: thesis eq. 3.3.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.sampling import VECTOR
from vo.patches.zncc import MIN_CONTRAST


@compiled(fastmath={"reassoc", "contract"})
def write_patch(image: Image, u: int, v: int, radius: int, patch: Array) -> bool:
    """Write the patch about a pixel with zero mean and unit norm; False if it is flat."""
    side = 2 * radius + 1
    total = squares = np.float32(0)
    for j in range(side):
        row = image[v - radius + j]
        for k in range(side):
            value = np.float32(row[u - radius + k])
            patch[j * side + k] = value
            total += value
    mean = total / np.float32(side * side)
    for k in range(side * side):
        patch[k] -= mean
        squares += patch[k] * patch[k]
    norm = np.sqrt(squares)
    if norm < MIN_CONTRAST * side:
        return False
    for k in range(side * side):
        patch[k] /= norm
    return True


class RowWorkspace(NamedTuple):
    """Arrays (W,), float32: grey levels of a row, their sums and squares, products, and scores."""

    levels: Array
    sums: Array
    squares: Array
    products: Array
    scores: Array


@compiled()
def row_workspace(span: int, radius: int) -> RowWorkspace:
    """Allocate for the correlation of patches along at most so many columns."""
    work = np.zeros((5, span + VECTOR + 2 * radius), dtype=np.float32)
    return RowWorkspace(work[0], work[1], work[2], work[3], work[4])


@compiled(fastmath={"reassoc", "contract"})
def correlate_row(
    patch: Array, image: Image, first: int, last: int, v: int, radius: int, work: RowWorkspace
) -> int:
    """Correlate a patch with those about the columns first to last of row v.

    The ZNCC are written to the scores of the workspace; their number is returned.
    """
    levels, sums, squares, products, scores = work
    extent = 2 * radius + 1, last - first + 1
    corner = first - radius, v - radius
    _add_products(patch, image, corner, extent, levels, sums, squares, products)
    _normalise(sums, squares, products, extent, levels, scores)
    return extent[1]


@compiled(fastmath={"reassoc", "contract"}, distinct=True)
def _add_products(
    patch: Array, image: Image, corner: tuple[int, int], extent: tuple[int, int], levels: Array,
    sums: Array, squares: Array, products: Array,
) -> None:  # fmt: skip
    """Sum columns of the image, their squares, and the products of the patch at each place."""
    side, one, two, three = np.uint64(extent[0]), np.uint64(1), np.uint64(2), np.uint64(3)
    whole = np.uint64((extent[1] + VECTOR - 1) // VECTOR * VECTOR)
    length = np.uint64(extent[1]) + side - one
    u, v = np.uint64(corner[0]), np.uint64(corner[1])
    pivot = np.float32(image[v, u])
    for x in range(length):
        sums[x] = squares[x] = np.float32(0)
    for x in range(whole):
        products[x] = np.float32(0)
    for j in range(side):
        for x in range(length):
            level = np.float32(image[v + j, u + x]) - pivot
            levels[x] = level
            sums[x] += level
            squares[x] += level * level
        k = np.uint64(0)
        while k + three <= side:  # at once, to load and store the products less often
            at = j * side + k
            a, b, c = patch[at], patch[at + one], patch[at + two]
            for x in range(whole):
                products[x] += a * levels[x + k] + b * levels[x + k + one] + c * levels[x + k + two]
            k += three
        while k < side:
            a = patch[j * side + k]
            for x in range(whole):
                products[x] += a * levels[x + k]
            k += one


@compiled(fastmath={"reassoc", "contract"}, distinct=True)
def _normalise(
    sums: Array, squares: Array, products: Array, extent: tuple[int, int], energies: Array,
    scores: Array,
) -> None:  # fmt: skip
    """Divide products by the norms of the patches, whose energies are written on the way."""
    side, count = np.uint64(extent[0]), np.uint64(extent[1])
    samples = np.float32(extent[0] * extent[0])
    floor = np.float32((MIN_CONTRAST * extent[0]) ** 2)
    total = square = np.float32(0)
    for k in range(side - np.uint64(1)):
        total += sums[k]
        square += squares[k]
    for x in range(count):
        end = x + side - np.uint64(1)
        total += sums[end]
        square += squares[end]
        energies[x] = square - total * total / samples
        total -= sums[x]
        square -= squares[x]
    for x in range(count):
        scores[x] = products[x] / np.sqrt(max(energies[x], floor))


@compiled()
def highest(scores: Array, count: int) -> int:
    """Find the first of the highest scores."""
    best = 0
    for x in range(1, count):
        if scores[x] > scores[best]:
            best = x
    return best
