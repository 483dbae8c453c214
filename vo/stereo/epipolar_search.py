"""Whole-pixel search along the epipolar row by ZNCC, at chosen pixels only.

Source: thesis eq. 3.3 for the correlation; Fua, A Parallel Stereo Algorithm that Produces Dense
Depth Maps and Preserves Image Features, MVA 1993, for the check from the other image.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.row_correlation import correlate_row, highest, row_workspace, write_patch

PEAK_PX = 2
"""Half width of a peak of correlation; correlations further away belong to another peak."""


def search_epipolar(
    left: Image, right: Image, pixels: Array, nearest_px: Array, farthest_px: Array, patch_px: int,
    rows: Array | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Find the disparity at which the patches of the two images correlate best.

    Pixels (N, 2) are rounded to whole ones. The search is between the largest disparity (N,), as
    far as the patch stays in the image, and the smallest one (N,), which may be negative; there is
    none where either is NaN. The side of the patch is odd. In the right image, the rows (N,) are
    those of the pixels unless given.

    Returns:
        (N,) whole disparity, NaN where the patch is flat or leaves the image, or where the best
        match of the right patch among the same disparities is another left patch; (N,) its ZNCC;
        (N,) the highest ZNCC of another peak, -1 where there is none.
    """
    columns = [pixels[:, 0], pixels[:, 1], pixels[:, 1] if rows is None else rows]
    places = np.stack([*np.rint(columns), np.ceil(nearest_px), np.floor(farthest_px)], axis=-1)
    return _search_all(left, right, places, patch_px // 2)


@compiled()
def _search_all(
    left: Image, right: Image, places: Array, radius: int
) -> tuple[Array, Array, Array]:
    """Search for each row u, v, v in the right image, largest and smallest disparity, (N, 5)."""
    n = len(places)
    disparity, zncc, second = np.full(n, np.nan), np.full(n, np.nan), np.full(n, -1.0)
    height, width = left.shape
    span = 1
    for i in range(n):
        if _is_finite(places, i):
            span = max(span, min(int(places[i, 3]) - int(places[i, 4]) + 1, width))
    work = row_workspace(span, radius)
    scores = work.scores
    patch = np.empty((2 * radius + 1) ** 2, dtype=np.float32)
    for i in range(n):
        if not _is_finite(places, i):
            continue
        u, v, row = int(places[i, 0]), int(places[i, 1]), int(places[i, 2])
        nearest, farthest = int(places[i, 3]), int(places[i, 4])
        if v < radius or v >= height - radius or u < radius or u >= width - radius:
            continue
        if row < radius or row >= height - radius:
            continue
        first, last = max(u - nearest, radius), min(u - farthest, width - 1 - radius)
        if last < first or not write_patch(left, u, v, radius, patch):
            continue
        count = correlate_row(patch, right, first, last, row, radius, work)
        best = highest(scores, count)
        other = np.float32(-1)
        for j in range(count):
            if abs(j - best) > PEAK_PX and scores[j] > other:
                other = scores[j]
        score, there = scores[best], first + best
        first, last = max(there + farthest, radius), min(there + nearest, width - 1 - radius)
        if not write_patch(right, there, row, radius, patch):
            continue
        count = correlate_row(patch, left, first, last, v, radius, work)
        back = first + highest(scores, count)
        if abs(back - u) <= 1:
            disparity[i], zncc[i], second[i] = u - there, score, other
    return disparity, zncc, second


@compiled()
def _is_finite(places: Array, i: int) -> bool:
    total = 0.0
    for k in range(5):
        total += places[i, k] * 0
    return total == 0  # not NaN
