"""CenSurE: extrema of centre-surround responses over space and scale (thesis 3.2).

All scales are computed at every pixel, so that positions are as exact at the largest scale. The
image is passed once, row by row: running sums, responses and the search for extrema need a few
rows, which stay in the cache.

Source: Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas for Realtime Feature
Detection and Matching, ECCV 2008.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.features.censure_kernels import Kernels, kernels
from vo.features.integral_images import KEPT_ROWS, PAD, add_boundaries, append_row, locate
from vo.features.subpixel import vertex

LANES = 64
"""Rows hold a whole multiple of this many columns, so that no vector loop has a remainder."""


class Rows(NamedTuple):
    """Rows of an image in use, `wide` columns for W.

    Attributes:
        tables: (KEPT_ROWS, 4, PAD + wide + PAD) int16, see `integral_images.append_row`.
        pixels: (2, PAD + wide + PAD) int16, a row of the image and the sums of its pixels.
        places: (KEPT_ROWS, P, 8) uint64, of boundaries in tables, see `integral_images.locate`.
        gained: (wide,) int16, what octagons gain from one row to the next.
        sums: (R, wide) float32 sums over the regions of the kernels.
        responses: (K, S, wide) float32, row v in v % K: the contrast of a blob at every pixel and
            scale, the mean of the centre minus that of the surround, times the kernel's gain
            (section 3.2, equations 2 and 3).
        bounds: (2, S, wide) float32, highest and lowest of two rows and three columns of these.
        marks: (wide,) uint8, columns that may hold an extremum.
        blocks: (wide / 8,) uint64, the same memory.
        columns: (2, wide + 1) int64, the same as a list, for each of two rows.
        around: (3, 3, 3) float32 responses about a pixel by scale, row and column.
    """

    tables: Array
    pixels: Array
    places: Array
    gained: Array
    sums: Array
    responses: Array
    bounds: Array
    marks: Array
    blocks: Array
    columns: Array
    around: Array


def allocate_rows(width: int, shape: Kernels, kept: int) -> Rows:
    """Allocate rows of images of a width; of responses the last `kept`, 4 or a power of two above.

    All zero, so that what lies beside the image stays black.
    """
    wide = -(-width // LANES) * LANES
    columns, scales = wide + 2 * PAD, len(shape.margin)
    marks = np.zeros(wide, dtype=np.uint8)
    return Rows(
        tables=np.zeros((KEPT_ROWS, 4, columns), dtype=np.int16),
        pixels=np.zeros((2, columns), dtype=np.int16),
        places=locate(shape.corners, columns),
        gained=np.zeros(wide, dtype=np.int16),
        sums=np.zeros((shape.regions.max() + 1, wide), dtype=np.float32),
        responses=np.zeros((kept, scales, wide), dtype=np.float32),
        bounds=np.zeros((2, scales, wide), dtype=np.float32),
        marks=marks,
        blocks=marks.view(np.uint64),
        columns=np.zeros((2, wide + 1), dtype=np.int64),
        around=np.zeros((3, 3, 3), dtype=np.float32),
    )


@lru_cache(maxsize=8)
def _shared_rows(width: int, kernel: str) -> Rows:
    """Keep the rows from image to image: new memory costs a page fault every 4 KiB.

    One compiled call writes and reads them, during which no other thread runs.
    """
    return allocate_rows(width, kernels(kernel), kept=4)


def censure(image: Image, settings: FeatureSettings) -> Array:
    """Find all extrema of an image, in order of scale, row and column: (N, 6) candidates.

    The response is the contrast, grey levels, of the Gaussian blob with the same extremum, positive
    where it is brighter than its surround. Scales that do not fit into the image are left out.
    """
    shape = kernels(settings.kernel)
    capacity = image.size // 16
    while True:
        found = np.empty((len(shape.margin), capacity, 6))
        rows = _shared_rows(image.shape[1], settings.kernel)
        counts = find_extrema(image, shape, settings.threshold, rows, found)
        if max(counts) <= capacity:
            return np.concatenate([x[:count] for x, count in zip(found, counts, strict=True)])
        capacity = max(counts)  # a pattern of a few pixels


def find_extrema(
    image: Image, shape: Kernels, threshold: float, rows: Rows, found: Array
) -> list[int]:
    """Find the extrema over 3x3x3 neighbours with |response| > threshold.

    Only where all neighbours have a response, the scale above included: where the surround fits
    into the image.

    Args:
        image: (H, W) uint8.
        shape: Kernels of S scales.
        threshold: Grey levels.
        rows: From `allocate_rows` for the image's width; overwritten.
        found: (S, N, 6), at each scale the candidates that fit in, in order of row and column.

    Returns:
        The number of extrema of each scale, which may exceed N.
    """
    counts = np.zeros(len(found), dtype=np.int64)
    least = np.nextafter(np.float32(threshold), np.float32(np.inf))
    _pass_rows(image, shape, least, rows, found, counts)
    return counts.tolist()


@compiled()
def _pass_rows(
    image: Image, shape: Kernels, least: float, rows: Rows, found: Array, counts: Array
) -> None:
    # Each use of an attribute, or of a view, in a loop would cost two atomic counts of references.
    tables, pixels, places, gained, sums, responses, bounds, marks, blocks, columns, around = rows
    pieces, regions, weights = shape.pieces, shape.regions, shape.weights
    margin, window_px = shape.margin, shape.window_px
    flat_tables, flat_sums = tables.reshape(tables.size), sums.reshape(sums.size)
    for i in range(len(flat_tables)):
        flat_tables[i] = 0
    for i in range(len(flat_sums)):
        flat_sums[i] = 0.0
    height, width = image.shape
    for last in range(height + margin[-1]):
        append_row(image, last, tables, pixels)
        v = last - margin[-1]  # the largest octagons about this row end in the last one
        add_boundaries(tables, v, pieces, places, gained, sums)
        if v >= 0:
            _weigh_sums(sums, regions, weights, v, responses)
        if v < 3 or v % 2 == 0:
            continue
        first = v - 2  # of two rows, all of whose neighbours have their responses
        _bound_pairs(responses, first, bounds)
        for s in range(1, len(found) - 1):
            edge = margin[s + 1] + 1
            if first + 1 < edge or first >= height - edge or 2 * edge >= width:
                continue
            _mark_pairs(responses, first, s, bounds, least, marks)
            listed = _list_marked(marks, blocks, edge, width - edge, columns)
            for k in range(2):
                if listed[k] > 0 and edge <= first + k < height - edge:
                    here = columns[k, : listed[k]]
                    _take_extrema(responses, first + k, s, here, around, window_px, found, counts)


@compiled(no_cpython_wrapper=True)
def _weigh_sums(sums: Array, regions: Array, weights: Array, v: int, responses: Array) -> None:
    row = v & (len(responses) - 1)
    for s in range(len(regions)):
        centre, whole = regions[s, 0], regions[s, 1]
        for_centre, for_whole = weights[s, 0], weights[s, 1]
        for u in range(sums.shape[1]):
            responses[row, s, u] = sums[centre, u] * for_centre + sums[whole, u] * for_whole


@compiled(no_cpython_wrapper=True)
def _bound_pairs(responses: Array, v: int, bounds: Array) -> None:
    """Find the highest and the lowest of two rows, v and the next, and three columns."""
    a, b = v & (len(responses) - 1), (v + 1) & (len(responses) - 1)
    for s in range(bounds.shape[1]):
        for u in range(1, bounds.shape[2] - 1):
            x0, x1, x2 = responses[a, s, u - 1], responses[a, s, u], responses[a, s, u + 1]
            y0, y1, y2 = responses[b, s, u - 1], responses[b, s, u], responses[b, s, u + 1]
            bounds[0, s, u] = max(max(max(x0, y0), max(x1, y1)), max(x2, y2))
            bounds[1, s, u] = min(min(min(x0, y0), min(x1, y1)), min(x2, y2))


@compiled(no_cpython_wrapper=True)
def _mark_pairs(
    responses: Array, v: int, s: int, bounds: Array, least: float, marks: Array
) -> None:
    """Mark columns of row v with 1, of the next with 2, that few of 26 neighbours can exceed."""
    last, most = len(responses) - 1, np.float32(-least)
    before, first, second, after = (v - 1) & last, v & last, (v + 1) & last, (v + 2) & last
    for u in range(len(marks)):
        above, a = responses[before, s, u], responses[first, s, u]
        b, below = responses[second, s, u], responses[after, s, u]
        highest = max(max(bounds[0, s - 1, u], bounds[0, s, u]), max(bounds[0, s + 1, u], least))
        lowest = min(min(bounds[1, s - 1, u], bounds[1, s, u]), min(bounds[1, s + 1, u], most))
        upper = (a >= max(highest, above)) | (a <= min(lowest, above))
        lower = (b >= max(highest, below)) | (b <= min(lowest, below))
        marks[u] = np.uint8(upper) + np.uint8(2) * np.uint8(lower)


@compiled(no_cpython_wrapper=True)
def _list_marked(
    marks: Array, blocks: Array, begin: int, end: int, columns: Array
) -> tuple[int, int]:
    """List the columns that are marked with 1 and with 2; without branches where there are any."""
    upper = lower = 0
    for block in range(begin // 8, (end + 7) // 8):
        if blocks[block] != 0:
            for u in range(max(8 * block, begin), min(8 * block + 8, end)):
                columns[0, upper] = columns[1, lower] = u
                upper += marks[u] & 1
                lower += marks[u] >> 1
    return upper, lower


@compiled(no_cpython_wrapper=True)
def _take_extrema(
    responses: Array, v: int, s: int, columns: Array, around: Array, window_px: Array,
    found: Array, counts: Array,
) -> None:  # fmt: skip
    """Write the extrema among columns of a row to `found`, while there is space, and count them."""
    last = len(responses) - 1
    above, here, below = (v - 1) & last, v & last, (v + 1) & last
    for m in range(len(columns)):
        u = columns[m]
        for i in range(3):
            for k in range(3):
                around[i, 0, k] = responses[above, s + i - 1, u + k - 1]
                around[i, 1, k] = responses[here, s + i - 1, u + k - 1]
                around[i, 2, k] = responses[below, s + i - 1, u + k - 1]
        if _is_extremum(around):
            n = counts[s]
            counts[s] += 1
            if n < found.shape[1]:
                du, dv = vertex(around, 1, 1, 1)
                found[s, n, 0], found[s, n, 1], found[s, n, 2] = u + du, v + dv, around[1, 1, 1]
                found[s, n, 3], found[s, n, 4], found[s, n, 5] = u, v, window_px[s]


@compiled(no_cpython_wrapper=True)
def _is_extremum(around: Array) -> bool:
    """Whether the middle of 3x3x3 values exceeds the others; of equal ones, the first does."""
    sign = np.float32(1.0) if around[1, 1, 1] > 0 else np.float32(-1.0)
    before, after = sign * around[1, 1, 0], sign * around[1, 1, 2]
    for k in range(3):
        before, after = max(before, sign * around[1, 0, k]), max(after, sign * around[1, 2, k])
        for j in range(3):
            before, after = max(before, sign * around[0, j, k]), max(after, sign * around[2, j, k])
    return before < sign * around[1, 1, 1] and after <= sign * around[1, 1, 1]
