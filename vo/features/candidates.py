"""Candidates of features, and the choice of the strongest of each image cell that are corners."""

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled


def select_corners(candidates: Array, image: Image, settings: FeatureSettings) -> Array:
    """Select at most `count` candidates (N, 6) that are corners, the best of each cell in turn.

    Candidates are rows (u_px, v_px, response, u, v, reach): where a detector's response has an
    extremum, the response in grey levels, and the square, its centre and half side in pixels,
    over which the gradients of a corner must not be of one direction; with reach 0 all are corners.

    Returns:
        (M, 6), the strongest first, of equal ones the first. The gradients are examined only where
        a candidate is the next of its cell.
    """
    strength = np.abs(candidates[:, 2].astype(np.float32))
    # Sorting integers, strength over index, is several times faster than a stable sort of floats.
    order = np.sort(np.arange(len(strength)) - (strength.view(np.int32).astype(np.int64) << 32))
    ordered = candidates[order & 0xFFFFFFFF]
    first = np.full(np.prod(np.array(image.shape) // settings.cell_px + 1), -1)
    ranked = np.empty_like(order)
    limits = settings.cell_px, settings.count, settings.line_ratio
    total = _rank_corners(image, ordered, limits, first, ranked)
    chosen = np.sort(ranked[:total])[: settings.count] % max(len(ordered), 1)
    return ordered[np.sort(chosen)]


@compiled()
def _rank_corners(
    image: Image, ordered: Array, limits: tuple[int, int, float], first: Indices, ranked: Indices
) -> int:
    """Number corners by their rank in their cell: rank times N plus index, of N candidates.

    Ends after the rank with which there are `count` of them. Returns how many are numbered.
    """
    cell_px, count, max_ratio = limits
    columns = image.shape[1] // cell_px + 1
    following = ranked.copy()
    for i in range(len(ordered) - 1, -1, -1):
        k = int(ordered[i, 1]) // cell_px * columns + int(ordered[i, 0]) // cell_px
        following[i], first[k] = first[k], i  # of the cell, not yet examined
    total, rank, more = 0, 0, True
    while more and total < count:
        more = False
        for k in range(len(first)):
            i = first[k]
            while i >= 0 and not is_corner(image, ordered, i, max_ratio):
                i = following[i]
            if i >= 0:
                ranked[total] = rank * len(ordered) + i
                total, more, i = total + 1, True, following[i]
            first[k] = i
        rank += 1
    return total


@compiled(no_cpython_wrapper=True)
def is_corner(image: Image, candidates: Array, i: int, max_ratio: float) -> bool:
    """Whether the principal gradient energies in a candidate's square are of a similar size.

    Section 3.4 suppresses features on lines by the Harris measure at the feature's scale. The
    ratio r of the energies follows from trace² / determinant = (r + 1)² / r of the gradients'
    outer product, summed over the square.
    """
    u0, v0 = int(candidates[i, 3]), int(candidates[i, 4])
    reach = int(candidates[i, 5])
    if reach == 0:
        return True
    height, width = image.shape
    begin, end = max(u0 - reach, 1), min(u0 + reach + 1, width - 1)
    left, here, right = np.uint64(begin - 1), np.uint64(begin), np.uint64(begin + 1)
    xx = xy = yy = np.int32(0)
    for v in range(max(v0 - reach, 1), min(v0 + reach + 1, height - 1)):
        for u in range(np.uint64(end - begin)):
            du = np.int32(image[v, right + u]) - np.int32(image[v, left + u])
            dv = np.int32(image[v + 1, here + u]) - np.int32(image[v - 1, here + u])
            xx += np.int32(du * du)
            xy += np.int32(du * dv)
            yy += np.int32(dv * dv)
    trace, determinant = float(xx) + float(yy), float(xx) * float(yy) - float(xy) * float(xy)
    return trace**2 < (max_ratio + 1) ** 2 / max_ratio * determinant
