"""The certificate: how well right images, warped by the disparity label, explain left ones."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.labels import photometric_residual, visible_in_right
from vo.contract.arrays import Array, Image, Indices

SHIFT_PX = 0.5
SHARE = 0.8
FINE_GREY = 0.3
"""A frame passes if its median residual is at most FINE_GREY (what rounding two images leaves) or
less than SHARE of what a label wrong by SHIFT_PX, to either side, would leave: texture decides
how large a residual is, and no constant fits every scene."""

ROW_STEP = 4
BINS_PER_GREY = 50
"""Resolution of the histograms: residuals are exact to 1/50 grey level."""


@dataclass(frozen=True)
class FrameResidual:
    """One frame's photometric residuals on the left pixels that the right camera sees.

    Attributes:
        timestamp_ns: The frame's.
        histogram: (256 * BINS_PER_GREY + 1,) pixels by absolute residual.
        shifted_median: Median residual of the better of two labels shifted by +-SHIFT_PX.
        visible_fraction: Visible pixels over all pixels.
    """

    timestamp_ns: int
    histogram: Indices
    shifted_median: float
    visible_fraction: float

    @property
    def median(self) -> float:
        """In grey levels."""
        return quantile(self.histogram, 0.5)

    @property
    def passed(self) -> bool:
        """Whether the label explains the pixels."""
        return self.median <= max(FINE_GREY, SHARE * self.shifted_median)


def measure_frame(
    timestamp_ns: int, left: Image, right: Image, disparity_px: Array
) -> FrameResidual:
    """Warp the right image (H, W[, 3]) onto the left by the (H, W) label disparity and compare.

    Rows of a rectified pair know nothing of each other, so every ROW_STEP-th is as good as all.
    """
    left, right, disparity_px = (a[::ROW_STEP] for a in (left, right, disparity_px))
    visible = visible_in_right(disparity_px)

    def histogram(shift_px: float) -> Indices:
        shifted = disparity_px + np.float32(shift_px)
        residual = np.abs(photometric_residual(left, right, shifted, visible))
        bins = np.minimum(residual * BINS_PER_GREY, 256 * BINS_PER_GREY).astype(np.int64)
        return np.bincount(bins, minlength=256 * BINS_PER_GREY + 1)

    shifted_median = min(quantile(histogram(shift_px), 0.5) for shift_px in (-SHIFT_PX, SHIFT_PX))
    return FrameResidual(timestamp_ns, histogram(0.0), shifted_median, float(visible.mean()))


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
    return {
        "about": "absolute grey-level difference between left and right warped by disparity0, "
        f"bicubic, on the pixels of every {ROW_STEP}th row that the right camera sees",
        "median_grey": quantile(total, 0.5),
        "rms_grey": round(rms, 4),
        "p95_grey": quantile(total, 0.95),
        "worst_frame_ns": worst.timestamp_ns,
        "worst_frame_median_grey": worst.median,
        "visible_fraction": round(float(np.mean([f.visible_fraction for f in frames])), 6),
        "shifted_median_grey": round(float(np.median([f.shifted_median for f in frames])), 4),
        "rule": f"a frame passes if its median is at most {FINE_GREY:g}, or {SHARE:g} times "
        f"what a disparity wrong by {SHIFT_PX:g} px leaves",
        "failed_frames_ns": [frame.timestamp_ns for frame in frames if not frame.passed],
        "passed": all(frame.passed for frame in frames),
    }
