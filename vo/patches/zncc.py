"""Matching of mutual nearest neighbours by ZNCC (marriage assignment of thesis 3.2, eq. 3.1)."""

import numpy as np

from vo.config import MatchingSettings
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled

MIN_CONTRAST = 1.0
"""Smallest standard deviation, grey levels, of a patch that is not flat."""


def describe(image: Image, pixels: Array, patch_px: int) -> Array:
    """Normalise the patch of odd side about each of (N, 2) pixels: a dot product is the ZNCC.

    (N, patch_px**2) float32 of zero mean and unit norm. All zero, and so matching nothing, where
    the patch is flat or leaves the image. Pixels are rounded to the nearest ones.
    """
    centred = _centre_patches(image, np.rint(pixels).astype(np.int64), patch_px)
    norm = np.sqrt(np.add.reduce(centred * centred, axis=1, keepdims=True))
    centred /= np.maximum(norm, 1)
    centred[norm[:, 0] <= MIN_CONTRAST * patch_px] = 0
    return centred


@compiled()
def _centre_patches(image: Image, pixels: Indices, patch_px: int) -> Array:
    """Subtract their mean from patches about pixels: (N, patch_px**2) float32, 0 outside."""
    height, width = image.shape
    reach = patch_px // 2
    patches = np.zeros((len(pixels), patch_px * patch_px), dtype=np.float32)
    for i in range(len(pixels)):
        left, top = pixels[i, 0] - reach, pixels[i, 1] - reach
        if not (0 <= left <= width - patch_px and 0 <= top <= height - patch_px):
            continue
        total = 0
        for v in range(patch_px):
            for u in range(patch_px):
                total += image[top + v, left + u]
        mean = np.float32(total) / np.float32(patch_px * patch_px)
        for v in range(patch_px):
            for u in range(patch_px):
                patches[i, v * patch_px + u] = np.float32(image[top + v, left + u]) - mean
    return patches


def match_mutual(
    vectors_a: Array,
    expected_a: Array,
    vectors_b: Array,
    pixels_b: Array,
    radius_px: float,
    settings: MatchingSettings,
) -> Indices:
    """Pair features that are each other's nearest neighbour within the search window.

    (K, 2) index pairs (into a, into b), one to one, in order of a. The vectors (N, P) and (M, P)
    are from `describe`. The window reaches by a radius to each side of the expected position
    (N, 2) of each of a in image b; a NaN matches nothing.
    """
    pixels_b = np.asarray(pixels_b, dtype=np.float64)
    by_row = np.argsort(pixels_b[:, 1], kind="stable")
    best_b, best_a = _find_nearest(
        vectors_a, np.asarray(expected_a, dtype=np.float64), vectors_b,
        pixels_b, by_row, radius_px, settings.min_zncc,
    )  # fmt: skip
    a = np.flatnonzero(best_b >= 0)
    mutual = a[best_a[best_b[a]] == a]
    return np.stack([mutual, best_b[mutual]], axis=-1)


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _find_nearest(
    vectors_a: Array, expected_a: Array, vectors_b: Array, pixels_b: Array, by_row: Indices,
    radius: float, min_zncc: float,
) -> tuple[Indices, Indices]:  # fmt: skip
    """Find the nearest neighbour of each a among b and of each b among a; -1 without one.

    Only pairs inside the search window are correlated. Of equals (two scales) the first counts.
    """
    rows = pixels_b[by_row, 1]
    best_b = np.full(len(vectors_a), -1, dtype=np.int64)
    best_a = np.full(len(vectors_b), -1, dtype=np.int64)
    score_b = np.full(len(vectors_b), min_zncc, dtype=np.float32)
    for a in range(len(vectors_a)):
        score_a = np.float32(min_zncc)
        u, v = expected_a[a]
        for k in range(np.searchsorted(rows, v - radius), np.searchsorted(rows, v + radius)):
            b = by_row[k]
            if not abs(pixels_b[b, 0] - u) < radius:  # also where the expectation is NaN
                continue
            score = np.float32(0.0)
            for i in range(vectors_a.shape[1]):
                score += vectors_a[a, i] * vectors_b[b, i]
            if score > score_a or (score == score_a and b < best_b[a]):
                score_a, best_b[a] = score, b
            if score > score_b[b]:
                score_b[b], best_a[b] = score, a
    return best_b, best_a
