"""CenSurE: centre-surround extrema of octagons over space and scale (thesis 3.2).

Source: Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas for Realtime Feature
Detection and Matching, ECCV 2008. The octagon of parameters (m, n) has horizontal and vertical
sides of m pixels and slanted sides of n rows, so it is m + 2 n pixels wide and high.
"""

from dataclasses import dataclass

import numba
import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image, Indices

INNER = ((3, 0), (3, 1), (3, 2), (5, 2), (5, 3), (7, 3), (9, 4))
OUTER = ((5, 2), (5, 3), (7, 3), (9, 4), (9, 7), (13, 7), (15, 10))
"""(m, n) of centre and surround at the seven scales (Agrawal et al., table 1)."""


@dataclass(frozen=True)
class Features:
    """Keypoints of one image, strongest first.

    Attributes:
        pixels: (N, 2) float64 (u, v), sub-pixel, centres on integers.
        scale_px: (N,) radius of the surround, interpolated between scales.
        response: (N,) signed centre minus surround, grey levels; positive is brighter.
    """

    pixels: Array
    scale_px: Array
    response: Array

    def __len__(self) -> int:
        return len(self.pixels)


def detect(image: Image, settings: FeatureSettings) -> Features:
    """Find the strongest features of an image, spread over its cells.

    Args:
        image: (H, W) uint8; scales that do not fit it are left out.
        settings: Thresholds and the number wanted.

    Returns:
        At most `settings.count` features.
    """
    responses = scale_space(image)
    found = _extrema(responses, settings.threshold)
    found = found[_line_ratio(image, found) < settings.line_ratio]
    strength = np.abs(responses[tuple(found.T)])
    return _interpolate(responses, found[_spread(found, strength, image.shape, settings)])


def scale_space(image: Image) -> Array:
    """Centre-minus-surround mean grey level at every pixel and scale: (7, H, W) float32.

    Zero where the surround octagon does not fit into the image.
    """
    height, width = image.shape
    tables = _prefix_sums(image)
    responses = np.zeros((len(INNER), height, width), dtype=np.float32)
    for response, inner, outer in zip(responses, INNER, OUTER, strict=True):
        margin = (outer[0] - 1) // 2 + outer[1]
        if min(height, width) <= 2 * margin:
            continue
        area, ring = octagon_area(*inner), octagon_area(*outer) - octagon_area(*inner)
        _center_surround(*tables, *inner, *outer, area, ring, response)
    return responses


def octagon_area(m: int, n: int) -> int:
    """Number of pixels of the octagon: m rows of m + 2 n and 2 n rows that shrink by 2 each."""
    return m * (m + 2 * n) + 2 * sum(m + 2 * k for k in range(n))


@numba.njit(cache=True)
def _prefix_sums(image: Image) -> tuple[Array, Array, Array]:
    """Three tables (H + 1, W + 1) int32 of the sums of all pixels above and to the left.

    With P[v, u] the sum of row v left of column u, entry (v + 1, u) adds up P downwards to row v:
    along the column (the integral image), along a falling diagonal that ends at u and moves right
    by one per row, and along a rising one that ends at u and moves left.
    """
    height, width = image.shape
    row = np.zeros(width + 1, dtype=np.int32)
    straight = np.zeros((height + 1, width + 1), dtype=np.int32)
    falling = np.zeros_like(straight)
    rising = np.zeros_like(straight)
    for v in range(height):
        for u in range(width):
            row[u + 1] = row[u] + image[v, u]
        straight[v + 1] = straight[v] + row
        falling[v + 1, 1:] = falling[v, :-1] + row[1:]
        rising[v + 1, :-1] = rising[v, 1:] + row[:-1]
        rising[v + 1, -1] = straight[v, -1] + row[-1]  # beyond the image P stays the row's sum
    return straight, falling, rising


@numba.njit(cache=True)
def _center_surround(
    straight: Array, falling: Array, rising: Array, m_inner: int, n_inner: int, m_outer: int,
    n_outer: int, area: int, ring: int, response: Array,
) -> None:  # fmt: skip
    """Write the mean of the centre minus that of the surround, wherever the surround fits."""
    size = m_outer + 2 * n_outer
    margin = size // 2
    trim = margin - (m_inner + 2 * n_inner) // 2
    height, width = straight.shape[0] - size, straight.shape[1] - size
    centre = np.empty(width, dtype=np.int32)
    both = np.empty(width, dtype=np.int32)
    inside, outside = np.float32(1 / area + 1 / ring), np.float32(1 / ring)
    for v in range(height):
        _octagon_sums(straight, falling, rising, m_inner, n_inner, v + trim, trim, centre)
        _octagon_sums(straight, falling, rising, m_outer, n_outer, v, 0, both)
        for u in range(width):
            response[v + margin, u + margin] = centre[u] * inside - both[u] * outside


@numba.njit(cache=True)
def _octagon_sums(
    straight: Array, falling: Array, rising: Array, m: int, n: int, v: int, u0: int, sums: Array
) -> None:
    """Sum octagons whose bounding squares have their upper left corners at row v, from column u0.

    The rectangle of m rows between two trapezoids, the upper of which grows by one pixel on each
    side per row while the lower shrinks.
    """
    size = m + 2 * n
    for i in range(len(sums)):
        u = u0 + i
        sums[i] = (
            straight[v + n + m, u + size]
            - straight[v + n, u + size]
            - straight[v + n + m, u]
            + straight[v + n, u]
        )
    if n == 0:
        return
    for i in range(len(sums)):
        u = u0 + i
        sums[i] += (
            falling[v + n, u + size - 1]
            - falling[v, u + n + m - 1]
            - rising[v + n, u + 1]
            + rising[v, u + n + 1]
        )
    for i in range(len(sums)):
        u = u0 + i
        sums[i] += (
            rising[v + size, u + n + m]
            - rising[v + n + m, u + size]
            - falling[v + size, u + n]
            + falling[v + n + m, u]
        )


@numba.njit(cache=True)
def _extrema(responses: Array, threshold: float) -> Array:
    """Rows (scale, v, u) of the extrema over 3x3x3 neighbours, |response| > threshold.

    Only where all neighbours have a response, the scale above included.
    """
    scales, height, width = responses.shape
    found = []
    for s in range(1, scales - 1):
        m, n = OUTER[s + 1]
        margin = m // 2 + n + 1
        for v in range(margin, height - margin):
            for u in range(margin, width - margin):
                value = responses[s, v, u]
                if -threshold <= value <= threshold:
                    continue
                before, after = responses[s, v, u - 1], responses[s, v, u + 1]
                above, below = responses[s, v - 1, u], responses[s, v + 1, u]
                if value > 0:  # most pixels are no extremum among these four already
                    beaten = before > value or after > value or above > value or below > value
                else:
                    beaten = before < value or after < value or above < value or below < value
                if not beaten and _is_extremum(responses, s, v, u):
                    found.append((s, v, u))
    rows = np.empty((len(found), 3), dtype=np.int64)
    for i in range(len(found)):
        rows[i, 0], rows[i, 1], rows[i, 2] = found[i]
    return rows


@numba.njit(cache=True)
def _is_extremum(responses: Array, s: int, v: int, u: int) -> bool:
    """Whether the centre beats its 26 neighbours; of equal ones, the first in memory wins."""
    value = responses[s, v, u]
    sign = 1.0 if value > 0 else -1.0
    for i in (0, -1, 1):
        for j in (-1, 0, 1):
            for k in (-1, 0, 1):
                other = sign * responses[s + i, v + j, u + k]
                before = (i, j, k) < (0, 0, 0)
                if other > sign * value or (before and other == sign * value):
                    return False
    return True


def _line_ratio(image: Image, found: Array) -> Array:
    """Ratio of the principal gradient energies around each (scale, v, u), 1 for a round blob.

    Agrawal et al., 3.4, suppress features on lines by the Harris measure at the feature's scale.
    """
    radius = np.array([(m + 2 * n) // 2 for m, n in INNER])[found[:, 0]] + 2
    trace, determinant = _structure(image, found, radius)
    root = np.sqrt(np.maximum(trace**2 / 4 - determinant, 0.0))
    return (trace / 2 + root) / np.maximum(trace / 2 - root, 1e-9)


@numba.njit(cache=True)
def _structure(image: Image, found: Array, radius: Array) -> tuple[Array, Array]:
    """Trace and determinant of the summed gradient outer product in a square about each point."""
    height, width = image.shape
    trace = np.zeros(len(found))
    determinant = np.zeros(len(found))
    for i in range(len(found)):
        _, v0, u0 = found[i]
        r = radius[i]
        xx = xy = yy = 0.0
        for v in range(max(v0 - r, 1), min(v0 + r + 1, height - 1)):
            for u in range(max(u0 - r, 1), min(u0 + r + 1, width - 1)):
                dx = float(image[v, u + 1]) - float(image[v, u - 1])
                dy = float(image[v + 1, u]) - float(image[v - 1, u])
                xx += dx * dx
                xy += dx * dy
                yy += dy * dy
        trace[i] = xx + yy
        determinant[i] = xx * yy - xy * xy
    return trace, determinant


def _spread(
    found: Array, strength: Array, shape: tuple[int, ...], settings: FeatureSettings
) -> Indices:
    """Choose indices of at most `count` features, taking the best of each image cell in turn."""
    cell = found[:, 1:] // settings.cell_px
    columns = -(-shape[1] // settings.cell_px)
    cell_id = cell[:, 0] * columns + cell[:, 1]
    order = np.lexsort((-strength, cell_id))
    first = np.searchsorted(cell_id[order], cell_id[order])
    rank = np.arange(len(order)) - first  # place within its cell, the best is 0
    chosen = order[np.lexsort((-strength[order], rank))][: settings.count]
    return chosen[np.argsort(-strength[chosen], kind="stable")]


def _interpolate(responses: Array, found: Array) -> Features:
    """Refine (scale, v, u) by a parabola along each axis through the extremum."""
    s, v, u = found.T
    centre = responses[s, v, u]
    ds = _peak(responses[s - 1, v, u], centre, responses[s + 1, v, u])
    dv = _peak(responses[s, v - 1, u], centre, responses[s, v + 1, u])
    du = _peak(responses[s, v, u - 1], centre, responses[s, v, u + 1])
    radius = np.array([(m + 2 * n) / 2 for m, n in OUTER])
    scale_px = np.interp(s + ds, np.arange(len(OUTER)), radius)
    pixels = np.stack([u + du, v + dv], axis=-1).astype(np.float64)
    return Features(pixels, scale_px, centre.astype(np.float64))


def _peak(before: Array, centre: Array, after: Array) -> Array:
    """Offset in [-0.5, 0.5] of the vertex of the parabola through three equidistant samples."""
    curvature = before - 2 * centre + after
    slope = (before - after) / 2
    offset = np.divide(slope, curvature, out=np.zeros_like(slope), where=curvature != 0)
    return np.clip(offset, -0.5, 0.5)
