"""CenSurE: extrema of centre-surround responses over space and scale (thesis 3.2).

All scales are computed at every pixel, so a feature's place is as exact at the largest scale as at
the smallest.

Source: Agrawal, Konolige and Blas, CenSurE: Center Surround Extremas for Realtime Feature
Detection and Matching, ECCV 2008.
"""

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.features.censure_kernels import Kernels, kernels
from vo.features.integral_images import add_octagons, prefix_sums
from vo.features.subpixel import peak, vertices


def censure(image: Image, settings: FeatureSettings) -> Array:
    """Find all features of an image.

    Args:
        image: (H, W) uint8; scales that do not fit it are left out.
        settings: Kernel and thresholds.

    Returns:
        (N, 4) rows (u_px, v_px, scale_px, response). The scale is the standard deviation of the
        Gaussian blob that would peak there in scale; the response is the contrast of that blob,
        grey levels, positive where it is brighter than its surround.
    """
    shape = kernels(settings.kernel)
    responses = scale_space(image, shape)
    found = _extrema(responses, shape.margin, settings.threshold)
    window_px = np.round(shape.centre_px).astype(np.int64) + 2
    found = found[_round(image, found, window_px, settings.line_ratio)]
    return _interpolate(responses, found, shape)


def scale_space(image: Image, shape: Kernels) -> Array:
    """Contrast of the blob at every pixel and scale, grey levels: (S, H, W) float32.

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
                _weigh(
                    sums[centre, inside], sums[whole, inside], weights[s], responses[s, v, inside]
                )


@compiled()
def _weigh(centre: Array, whole: Array, weights: Array, response: Array) -> None:
    for_centre, for_whole = weights[0], weights[1]
    for u in range(len(response)):
        response[u] = np.float32(centre[u]) * for_centre + np.float32(whole[u]) * for_whole


@compiled()
def _extrema(responses: Array, margin: Array, threshold: float) -> Array:
    """Rows (scale, v, u) of the extrema over 3x3x3 neighbours, |response| > threshold.

    Only where all neighbours have a response, the scale above included.
    """
    scales, height, width = responses.shape
    candidates = np.zeros((width + 7) // 8 * 8, dtype=np.uint8)
    blocks = candidates.view(np.uint64)  # eight pixels without a candidate are one look
    found = []
    for s in range(1, scales - 1):
        edge = margin[s + 1] + 1
        for v in range(edge, height - edge):
            if 2 * edge >= width:
                continue
            candidates[:] = 0
            _pick(responses, s, v, edge, threshold, candidates[edge : width - edge])
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
def _pick(responses: Array, s: int, v: int, edge: int, threshold: float, candidates: Array) -> None:
    """Mark the pixels of a row that pass the threshold and their six nearest neighbours."""
    count, faint = len(candidates), np.float32(threshold)
    rows = slice(edge, edge + count)
    here = responses[s, v, rows]
    left, right = responses[s, v, edge - 1 : edge - 1 + count], responses[s, v, edge + 1 :]
    up, down = responses[s, v - 1, rows], responses[s, v + 1, rows]
    finer, coarser = responses[s - 1, v, rows], responses[s + 1, v, rows]
    for i in range(count):
        x = here[i]
        most = max(max(max(left[i], right[i]), max(up[i], down[i])), max(finer[i], coarser[i]))
        least = min(min(min(left[i], right[i]), min(up[i], down[i])), min(finer[i], coarser[i]))
        candidates[i] = ((x > faint) & (x >= most)) | ((x < -faint) & (x <= least))


@compiled()
def _is_extremum(responses: Array, s: int, v: int, u: int) -> bool:
    """Whether the centre beats its 26 neighbours; of equal ones, the first in memory wins."""
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
def _round(image: Image, found: Array, window_px: Array, most_ratio: float) -> Array:
    """Whether the principal gradient energies about each (scale, v, u) are of a similar size.

    Section 3.4 suppresses features on lines by the Harris measure at the feature's scale. The
    ratio r of the energies follows from trace² / determinant = (r + 1)² / r of the gradients'
    outer product, summed over a square.
    """
    height, width = image.shape
    limit = (most_ratio + 1) ** 2 / most_ratio
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


def _interpolate(responses: Array, found: Array, shape: Kernels) -> Array:
    """Refine (scale, v, u) in the image and, by a parabola, between the scales."""
    s, v, u = found.T
    centre = responses[s, v, u]
    between = s + peak(responses[s - 1, v, u], centre, responses[s + 1, v, u])
    scale_px = np.interp(between, shape.blob_scale, shape.blob_sigma_px)
    pixels = found[:, :0:-1] + vertices(responses, found)
    return np.column_stack([pixels, scale_px, centre])
