"""ZNCC of a patch with all patches along a row of whole pixels.

Source: thesis eq. 3.3.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
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


@compiled(fastmath={"reassoc", "contract"})
def correlate_row(
    patch: Array, image: Image, first: int, last: int, v: int, radius: int, work: Array
) -> Array:
    """Correlate a patch with those about the columns first to last of row v: (L,) ZNCC."""
    side, count = 2 * radius + 1, last - first + 1
    length = count + 2 * radius
    segment, sums, squares = work[0, :length], work[1, :length], work[2, :length]
    products, scores = work[3, :count], work[4, :count]
    sums[:], squares[:], products[:] = 0, 0, 0
    pivot = np.float32(image[v, first])
    for j in range(side):
        row = image[v - radius + j, first - radius : last + radius + 1]
        for x in range(length):
            value = np.float32(row[x]) - pivot
            segment[x] = value
            sums[x] += value
            squares[x] += value * value
        for k in range(side):
            weight = patch[j * side + k]
            shifted = segment[k : k + count]
            for x in range(count):
                products[x] += weight * shifted[x]
    total = square = np.float32(0)
    for k in range(side - 1):
        total += sums[k]
        square += squares[k]
    floor = np.float32((MIN_CONTRAST * side) ** 2)
    for x in range(count):
        total += sums[x + side - 1]
        square += squares[x + side - 1]
        energy = square - total * total / np.float32(side * side)
        scores[x] = products[x] / np.sqrt(max(energy, floor))
        total -= sums[x]
        square -= squares[x]
    return scores
