"""Vignetting: the light lost towards the corners, from the same points at different places.

A point that both eyes see, or two frames, has the same light; what differs is the fall-off between
the places of its images, and a gain. The fall-off is that of the settings, 1 - vignetting r^2 with
r = 1 in the corner.

Source: Goldman and Chen, Vignette and exposure calibration and compensation, ICCV 2005.
"""

from dataclasses import dataclass

import numpy as np

from vo.contract.arrays import Array, Indices

ITERATIONS = 12
MIN_PAIRS = 200
MAX_VIGNETTING = 0.95


@dataclass(frozen=True)
class LightPairs:
    """N points at two places each.

    Attributes:
        r2: (N, 2) squared distance from the principal point; 1 in the corner.
        log_ratio: (N,) logarithm of the light at the second place over that at the first.
        group: (N,) pairs of images with one gain, from 0.
        frame: (N,) frames to which the pairs belong.
    """

    r2: Array
    log_ratio: Array
    group: Indices
    frame: Indices


def vignetting_by_frame(pairs: LightPairs, frames: int) -> tuple[Array, Array]:
    """Return weights and weighted estimates of the vignetting of each frame, (F,) each.

    The sum of the latter over that of the former is the estimate of any selection of frames: one
    step of Gauss and Newton from the robust estimate of all. All are zero with too few pairs.
    """
    weights, weighted = np.zeros(frames), np.zeros(frames)
    if len(pairs.log_ratio) < MIN_PAIRS:
        return weights, weighted
    vignetting = 0.0
    for _ in range(ITERATIONS):
        robust, slope, residual = _linearized(pairs, vignetting)
        change = (robust * slope * residual).sum() / max((robust * slope**2).sum(), 1e-12)
        vignetting = float(np.clip(vignetting + change, -MAX_VIGNETTING, MAX_VIGNETTING))
    robust, slope, residual = _linearized(pairs, vignetting)
    weights = np.bincount(pairs.frame, robust * slope**2, frames)
    gradient = np.bincount(pairs.frame, robust * slope * residual, frames)
    return weights, weights * vignetting + gradient


def _linearized(pairs: LightPairs, vignetting: float) -> tuple[Array, Array, Array]:
    """Return robust weight, slope by the vignetting, and residual of each pair, (N,) each.

    Gains are removed. Weights are those of Geman and McClure.
    """
    share = 1 - vignetting * pairs.r2
    residual = pairs.log_ratio - np.log(share[:, 1] / share[:, 0])
    slope = pairs.r2[:, 0] / share[:, 0] - pairs.r2[:, 1] / share[:, 1]
    residual = residual - _group_medians(residual, pairs.group)
    scale = 1.4826 * np.median(abs(residual)) + 1e-9
    robust = 1 / (1 + (residual / (2 * scale)) ** 2) ** 2
    slope = slope - _group_means(slope, robust, pairs.group)
    return robust, slope, residual - _group_means(residual, robust, pairs.group)


def _group_medians(values: Array, group: Indices) -> Array:
    """Return for each of (N,) values the median of its group."""
    order = np.lexsort((values, group))
    counts = np.bincount(group)
    starts = np.cumsum(counts) - counts
    middle = np.minimum(starts + counts // 2, len(values) - 1)
    return values[order][middle][group]


def _group_means(values: Array, weights: Array, group: Indices) -> Array:
    """Return for each of (N,) values the weighted mean of its group."""
    total = np.bincount(group, weights * values)
    return (total / np.maximum(np.bincount(group, weights), 1e-12))[group]
