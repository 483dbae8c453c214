"""CenSurE: extrema of centre-surround responses over space and scale (thesis 3.2).

All scales are computed at every pixel, so that positions are as exact at the largest scale.

Source: Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas for Realtime Feature
Detection and Matching, ECCV 2008.
"""

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.features.censure_kernels import Kernels, kernels
from vo.features.integral_images import add_octagons, prefix_sums
from vo.features.subpixel import vertices


def censure(image: Image, settings: FeatureSettings) -> Array:
    """Find all features of an image: (N, 3) rows (u_px, v_px, response).

    The response is the contrast, grey levels, of the Gaussian blob with the same extremum, positive
    where it is brighter than its surround. Scales that do not fit into the image are left out.
    """
    shape = kernels(settings.kernel)
    responses = scale_space(image, shape)
    found = _find_extrema(responses, shape.margin, settings.threshold)
    window_px = np.round(shape.centre_px).astype(np.int64) + 2
    found = found[_is_corner(image, found, window_px, settings.line_ratio)]
    s, v, u = found.T
    return np.column_stack([found[:, :0:-1] + vertices(responses, found), responses[s, v, u]])


def scale_space(image: Image, shape: Kernels) -> Array:
    """Measure the contrast of a blob at every pixel and scale, grey levels: (S, H, W) float32.

    The mean of the centre minus that of the surround, times the kernel's gain; zero where the
    surround does not fit into the image (section 3.2, equations 2 and 3).
    """
    responses = np.zeros((len(shape.margin), *image.shape), dtype=np.float32)
    _center_surround(
        prefix_sums(image), shape.pieces, shape.reach, shape.regions, shape.weights, responses
    )
    return responses


@compiled()
def _center_surround(
    tables: Array, pieces: Array, reach: Array, regions: Array, weights: Array, responses: Array
) -> None:
    scales, height, width = responses.shape
    sums = np.empty((len(reach), width), dtype=np.int32)  # of one row, while it is in the cache
    for v in range(height):
        sums[:] = 0
        for i in range(len(pieces)):
            region, sign, m, n = pieces[i]
            edge, half = reach[region], m // 2 + n
            if edge <= v < height - edge and 2 * edge < width:
                row = sums[region, edge : width - edge]
                add_octagons(tables, m, n, sign, v - half, edge - half, row)
        for s in range(scales):
            centre, whole = regions[s]
            edge = reach[whole]
            if edge <= v < height - edge and 2 * edge < width:
                inside = slice(edge, width - edge)
                _weigh_sums(
                    sums[centre, inside], sums[whole, inside], weights[s], responses[s, v, inside]
                )


@compiled()
def _weigh_sums(centre: Array, whole: Array, weights: Array, response: Array) -> None:
    for_centre, for_whole = weights[0], weights[1]
    for u in range(len(response)):
        response[u] = np.float32(centre[u]) * for_centre + np.float32(whole[u]) * for_whole


@compiled()
def _find_extrema(responses: Array, margin: Array, threshold: float) -> Array:
    """Find the extrema over 3x3x3 neighbours with |response| > threshold: (N, 3) scale, v, u.

    Only where all neighbours have a response, the scale above included.
    """
    scales, height, width = responses.shape
    candidates = np.zeros((width + 7) // 8 * 8, dtype=np.uint8)
    blocks = candidates.view(np.uint64)  # eight pixels are tested at once
    found = []
    for s in range(1, scales - 1):
        edge = margin[s + 1] + 1
        for v in range(edge, height - edge):
            if 2 * edge >= width:
                continue
            candidates[:] = 0
            _mark_candidates(responses, s, v, edge, threshold, candidates[edge : width - edge])
            for block in range(len(blocks)):
                if blocks[block] == 0:
                    continue
                for u in range(8 * block, 8 * block + 8):
                    if candidates[u] and _is_extremum(responses, s, v, u):
                        found.append((s, v, u))
    rows = np.empty((len(found), 3), dtype=np.int64)
    for i in range(len(found)):
        rows[i, 0], rows[i, 1], rows[i, 2] = found[i]
    return rows


@compiled()
def _mark_candidates(
    responses: Array, s: int, v: int, edge: int, threshold: float, candidates: Array
) -> None:
    """Mark the pixels of a row that pass the threshold and their six nearest neighbours."""
    count, limit = len(candidates), np.float32(threshold)
    rows = slice(edge, edge + count)
    here = responses[s, v, rows]
    left, right = responses[s, v, edge - 1 : edge - 1 + count], responses[s, v, edge + 1 :]
    up, down = responses[s, v - 1, rows], responses[s, v + 1, rows]
    finer, coarser = responses[s - 1, v, rows], responses[s + 1, v, rows]
    for i in range(count):
        x = here[i]
        highest = max(max(max(left[i], right[i]), max(up[i], down[i])), max(finer[i], coarser[i]))
        lowest = min(min(min(left[i], right[i]), min(up[i], down[i])), min(finer[i], coarser[i]))
        candidates[i] = ((x > limit) & (x >= highest)) | ((x < -limit) & (x <= lowest))


@compiled()
def _is_extremum(responses: Array, s: int, v: int, u: int) -> bool:
    """Whether the centre exceeds its 26 neighbours; of equal ones, the first in memory does."""
    sign = np.float32(1.0) if responses[s, v, u] > 0 else np.float32(-1.0)
    value = sign * responses[s, v, u]
    for i in (0, -1, 1):
        for j in (-1, 0, 1):
            for k in (-1, 0, 1):
                other = sign * responses[s + i, v + j, u + k]
                if other >= value and (other > value or (i, j, k) < (0, 0, 0)):
                    return False
    return True


@compiled(fastmath={"reassoc", "contract"})
def _is_corner(image: Image, found: Array, window_px: Array, max_ratio: float) -> Array:
    """Whether the principal gradient energies about each (scale, v, u) are of a similar size.

    Section 3.4 suppresses features on lines by the Harris measure at the feature's scale. The
    ratio r of the energies follows from trace² / determinant = (r + 1)² / r of the gradients'
    outer product, summed over a square.
    """
    height, width = image.shape
    limit = (max_ratio + 1) ** 2 / max_ratio
    kept = np.empty(len(found), dtype=np.bool_)
    for i in range(len(found)):
        s, v0, u0 = found[i]
        reach = window_px[s]
        xx = xy = yy = np.float32(0)
        columns = slice(max(u0 - reach, 1), min(u0 + reach + 1, width - 1))
        before = slice(columns.start - 1, columns.stop - 1)
        after = slice(columns.start + 1, columns.stop + 1)
        for v in range(max(v0 - reach, 1), min(v0 + reach + 1, height - 1)):
            left, right = image[v, before], image[v, after]
            up, down = image[v - 1, columns], image[v + 1, columns]
            for u in range(len(left)):
                du = np.float32(np.int32(right[u]) - np.int32(left[u]))
                dv = np.float32(np.int32(down[u]) - np.int32(up[u]))
                xx += du * du
                xy += du * dv
                yy += dv * dv
        determinant = float(xx) * float(yy) - float(xy) * float(xy)
        kept[i] = float(xx + yy) ** 2 < limit * determinant
    return kept
