"""Displacement of patches between two images, to within half a pixel, about a predicted place.

Images of half the size are searched exhaustively by ZNCC, with a parabola through the best place.
"""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.row_correlation import correlate_row, row_workspace, write_patch

RADIUS_PX = 4
"""Half width of the patches, pixels of the halved images."""


def halve(image: Image) -> Image:
    """Halve an image: each pixel is the mean of four."""
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(half, dtype=np.uint8)


def search_displacements(
    before: Image, now: Image, pixels: Array, expected: Array, radius_px: float
) -> tuple[Array, Array]:
    """Find the positions (N, 2) in an image of what was at pixels (N, 2) of another one.

    The images are halved; positions and pixels are those of whole images. The search window reaches
    by a radius to each side of the expected positions (N, 2). The correlations (N,) are there too.
    NaN where a patch is flat, or where it or the window leaves an image.
    """
    places = np.rint((np.column_stack([pixels, expected]) - 0.5) / 2)
    found = _search_all(before, now, places, int(np.ceil(radius_px / 2)))
    return pixels + 2 * found[:, :2], found[:, 2]


@compiled(fastmath={"reassoc", "contract"})
def _search_all(before: Image, now: Image, places: Array, radius: int) -> Array:
    """Search for displacement and correlation (N, 3) of each pixel and expected pixel (N, 4)."""
    found = np.full((len(places), 3), np.nan)
    height, width = now.shape
    side = 2 * RADIUS_PX + 1
    work = row_workspace(2 * radius + 1, RADIUS_PX)
    row = work.scores
    scores = np.empty((2 * radius + 1, 2 * radius + 1), dtype=np.float32)
    patch = np.empty(side * side, dtype=np.float32)
    for i in range(len(places)):
        if not np.isfinite(places[i]).all():
            continue
        u, v, u_now, v_now = (
            int(places[i, 0]), int(places[i, 1]), int(places[i, 2]), int(places[i, 3])
        )  # fmt: skip
        inside = RADIUS_PX <= u < before.shape[1] - RADIUS_PX
        inside = inside and RADIUS_PX <= v < before.shape[0] - RADIUS_PX
        if not inside or not write_patch(before, u, v, RADIUS_PX, patch):
            continue
        first, last = max(u_now - radius, RADIUS_PX), min(u_now + radius, width - 1 - RADIUS_PX)
        top, bottom = max(v_now - radius, RADIUS_PX), min(v_now + radius, height - 1 - RADIUS_PX)
        if last < first or bottom < top:
            continue
        best, column, line = np.float32(-2), 0, 0
        for y in range(bottom - top + 1):
            for x in range(correlate_row(patch, now, first, last, top + y, RADIUS_PX, work)):
                scores[y, x] = row[x]
                if row[x] > best:
                    best, column, line = row[x], x, y
        fine_u = fine_v = 0.0
        if 0 < column < last - first:
            fine_u = _vertex(scores[line, column - 1 : column + 2])
        if 0 < line < bottom - top:
            fine_v = _vertex(scores[line - 1 : line + 2, column])
        found[i, 0] = first + column + fine_u - u
        found[i, 1] = top + line + fine_v - v
        found[i, 2] = best
    return found


@compiled()
def _vertex(scores: Array) -> float:
    """Offset of the maximum of a parabola from the middle one of three scores, the best."""
    curvature = 2 * scores[1] - scores[0] - scores[2]
    return float((scores[2] - scores[0]) / (2 * curvature)) if curvature > 0 else 0.0
