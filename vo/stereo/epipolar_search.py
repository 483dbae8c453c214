"""Whole-pixel search along the epipolar row by ZNCC, at chosen pixels only.

Source: thesis eq. 3.3 for the correlation; Fua, A Parallel Stereo Algorithm that Produces Dense
Depth Maps and Preserves Image Features, MVA 1993, for the check from the other image.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.zncc import MIN_CONTRAST

PEAK_PX = 2
"""Half width of a peak of correlation; correlations further away belong to another peak."""


def search_epipolar(
    left: Image, right: Image, pixels: Array, nearest_px: Array, farthest_px: Array, patch_px: int
) -> tuple[Array, Array, Array]:
    """Find the disparity at which the patches of the two images correlate best.

    Pixels (N, 2) are rounded to whole ones. The search is between the largest disparity (N,), as
    far as the patch stays in the image, and the smallest one (N,), which may be negative; there is
    none where either is NaN. The side of the patch is odd.

    Returns:
        (N,) whole disparity, NaN where the patch is flat or leaves the image, or where the best
        match of the right patch among the same disparities is another left patch; (N,) its ZNCC;
        (N,) the highest ZNCC of another peak, -1 where there is none.
    """
    places = np.stack([*np.rint(pixels.T), np.ceil(nearest_px), np.floor(farthest_px)], axis=-1)
    return _search_all(left, right, places, patch_px // 2)


@compiled()
def _search_all(
    left: Image, right: Image, places: Array, radius: int
) -> tuple[Array, Array, Array]:
    """Search for each row u, v, largest and smallest disparity of `places` (N, 4)."""
    n = len(places)
    disparity, zncc, second = np.full(n, np.nan), np.full(n, np.nan), np.full(n, -1.0)
    height, width = left.shape
    span = 1
    for i in range(n):
        if np.isfinite(places[i]).all():
            span = max(span, min(int(places[i, 2]) - int(places[i, 3]) + 1, width))
    work = np.empty((5, span + 2 * radius), dtype=np.float32)
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(n):
        if not np.isfinite(places[i]).all():
            continue
        u, v, nearest, farthest = places[i].astype(np.int64)
        if v < radius or v >= height - radius or u < radius or u >= width - radius:
            continue
        first, last = max(u - nearest, radius), min(u - farthest, width - 1 - radius)
        if last < first or not _write_patch(left, u, v, radius, patch):
            continue
        scores = _correlate(patch, right, first, last, v, radius, work)
        best = int(np.argmax(scores))
        other = np.float32(-1)
        for j in range(len(scores)):
            if abs(j - best) > PEAK_PX and scores[j] > other:
                other = scores[j]
        score = scores[best]
        there = first + best
        first, last = max(there + farthest, radius), min(there + nearest, width - 1 - radius)
        if not _write_patch(right, there, v, radius, patch):
            continue
        back = first + int(np.argmax(_correlate(patch, left, first, last, v, radius, work)))
        if abs(back - u) <= 1:
            disparity[i], zncc[i], second[i] = u - there, score, other
    return disparity, zncc, second


@compiled(fastmath={"reassoc", "contract"})
def _write_patch(image: Image, u: int, v: int, radius: int, patch: Array) -> bool:
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
def _correlate(
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
