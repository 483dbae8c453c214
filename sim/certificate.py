"""The certificate: how well right images, warped by the disparity label, explain left ones."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.labels import photometric_residual, visible_in_right
from vo.contract.arrays import Array, Image, Indices

MEDIAN_MAX_GREY = 2.0
"""Largest median residual, overall and of the worst frame, of a dataset that passes."""

BINS_PER_GREY = 50
"""Resolution of the histograms: residuals are exact to 1/50 grey level."""


@dataclass(frozen=True)
class FrameResidual:
    """One frame's photometric residuals on the left pixels that the right camera sees.

    Attributes:
        timestamp_ns: The frame's.
        histogram: (256 * BINS_PER_GREY + 1,) pixels by absolute residual.
        visible_fraction: Visible pixels over all pixels.
    """

    timestamp_ns: int
    histogram: Indices
    visible_fraction: float

    @property
    def median(self) -> float:
        """In grey levels."""
        return quantile(self.histogram, 0.5)


def measure_frame(
    timestamp_ns: int, left: Image, right: Image, disparity_px: Array
) -> FrameResidual:
    """Warp the right image (H, W[, 3]) onto the left by the (H, W) label disparity and compare."""
    visible = visible_in_right(disparity_px)
    residual = np.abs(photometric_residual(left, right, disparity_px, visible))
    bins = np.minimum(residual * BINS_PER_GREY, 256 * BINS_PER_GREY).astype(np.int64)
    histogram = np.bincount(bins, minlength=256 * BINS_PER_GREY + 1)
    return FrameResidual(timestamp_ns, histogram, float(visible.mean()))


def quantile(histogram: Indices, q: float) -> float:
    """Absolute residual in grey levels that a share q of the pixels stay within; 0 without any."""
    cumulative = np.cumsum(histogram)
    return float(np.searchsorted(cumulative, q * cumulative[-1]) / BINS_PER_GREY)


def certify(frames: Iterable[FrameResidual]) -> dict[str, Any]:
    """Summarise all frames; the same images and labels always give the same numbers.

    Returns:
        JSON-ready content of the manifest's `certificate`.
    """
    frames = list(frames)
    total = np.sum([frame.histogram for frame in frames], axis=0)
    levels = np.arange(len(total)) / BINS_PER_GREY
    worst = max(frames, key=lambda frame: (frame.median, -frame.timestamp_ns))
    rms = float(np.sqrt((total * levels**2).sum() / max(total.sum(), 1)))
    median = quantile(total, 0.5)
    return {
        "about": "absolute grey-level difference between left and right warped by disparity0, "
        "bicubic, on left pixels that the right camera sees",
        "median_grey": median,
        "rms_grey": round(rms, 4),
        "p95_grey": quantile(total, 0.95),
        "worst_frame_ns": worst.timestamp_ns,
        "worst_frame_median_grey": worst.median,
        "visible_fraction": round(float(np.mean([f.visible_fraction for f in frames])), 6),
        "median_max_grey": MEDIAN_MAX_GREY,
        "passed": median <= MEDIAN_MAX_GREY and worst.median <= MEDIAN_MAX_GREY,
    }
