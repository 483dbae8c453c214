"""The quantities in which recordings are compared, and statistics that add up over frames."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from trials.realism.noise import GREY
from vo.contract.arrays import Array

Kind = Literal["histogram", "ratio", "difference"]
SMALLEST = 1e-3
"""Value that stands for a smaller one in ratios."""
TILE_PX = 32
"""Side of the tiles whose power spectra are averaged."""
NOISE_GREY, SHIFT_R2 = "noise_grey", "shift_r2"
"""Statistics that only help: mean grey level of the flat blocks of each bin, and how much farther
from the centre (squared, 1 in the corner) one eye sees points than the other."""
NO_TRACKS = "the estimator follows too few landmarks"


@dataclass(frozen=True)
class Quantity:
    """What is measured of a recording without truth.

    Attributes:
        label: Name with unit.
        kind: Distance of two recordings: of histograms, the mean shift (Wasserstein-1) over the
            standard deviation of the real one; the mean absolute logarithm of a ratio; or the mean
            absolute difference.
        x: (B,) values of the bins, or abscissae of the curve.
        axis: Label of the abscissae; empty for a single number.
        missing: Why a recording may have no estimate.
        least: Smallest total of the weights for an estimate.
    """

    label: str
    kind: Kind
    x: Array
    axis: str
    missing: str
    least: float = 1e-9


def _bins(width: float, count: int) -> Array:
    return width * (np.arange(count) + 0.5)


def _one() -> Array:
    return np.zeros(1)


_FLAT = "no grey level has enough flat blocks that are not clipped"
QUANTITIES: Mapping[str, Quantity] = {
    "grey": Quantity("grey level", "histogram", _bins(1, 256) - 0.5, "grey level", "no frame"),
    "noise": Quantity("noise variance, grey²", "ratio", GREY, "grey level", _FLAT),
    "gradient": Quantity("gradient, grey/px", "histogram", _bins(0.5, 256), "grey/px", "no frame"),
    "power": Quantity(
        *("power spectrum, grey²", "ratio", (np.arange(TILE_PX // 2) + 1) / TILE_PX),
        *("cycles/px", "images are smaller than a tile of 32 px"),
    ),
    "edge_width": Quantity(
        *("width of step edges, px", "histogram", _bins(0.05, 100), "px"),
        *("fewer than 30 step edges", 30.0),
    ),
    "vignetting": Quantity(
        *("vignetting, share of the light", "difference", _one(), ""),
        "fewer than 200 points that both eyes see at different distances from the centre",
    ),
    "right_gain": Quantity("light of the right eye", "ratio", _one(), "", NO_TRACKS, 30.0),
    "features": Quantity("features a frame", "ratio", _one(), "", "no frame"),
    "coverage": Quantity("share of the image with landmarks", "ratio", _one(), "", NO_TRACKS),
    "stereo_matches": Quantity("matches left to right a frame", "ratio", _one(), "", NO_TRACKS),
    "matches": Quantity("matches in time a frame", "ratio", _one(), "", NO_TRACKS),
    "inlier_ratio": Quantity("inlier ratio of matches in time", "ratio", _one(), "", NO_TRACKS),
    "stereo_residual": Quantity(
        *("residual left to right, grey", "histogram", _bins(0.25, 256), "grey levels"),
        *(NO_TRACKS, 30.0),
    ),
    "residual": Quantity(
        "residual in time, grey", "histogram", _bins(0.25, 256), "grey levels", NO_TRACKS, 30.0
    ),
    "disparity": Quantity("disparity, px", "histogram", _bins(0.5, 512), "px", NO_TRACKS, 30.0),
    "track_length": Quantity(
        "track length, frames", "histogram", _bins(1, 300) + 0.5, "frames", NO_TRACKS, 30.0
    ),
    "motion": Quantity(
        "image motion, px a frame", "histogram", _bins(0.25, 512), "px a frame", NO_TRACKS, 30.0
    ),
}
"""Quantities by name."""


@dataclass(frozen=True)
class Statistic:
    """Parts of a quantity in F frames, whose sums over frames give its estimate.

    Attributes:
        parts: (F, B) counts of a histogram; weighted values else.
        weights: (F, B) weights of the values; None for a histogram.
    """

    parts: Array
    weights: Array | None = None

    def pooled(self, counts: Array) -> Array:
        """Return estimates (R, B) for selections that contain each frame `counts` (R, F) times.

        A histogram is a density over its bins; NaN where there is too little.
        """
        total, weight = counts @ self.parts, counts @ self._all_weights
        return np.divide(total, weight, out=np.full(total.shape, np.nan), where=weight > 0)

    def is_enough(self, quantity: Quantity) -> bool:
        """Whether all frames together suffice for an estimate."""
        return bool(self._all_weights.sum() >= quantity.least)

    @property
    def _all_weights(self) -> Array:
        if self.weights is None:
            return self.parts.sum(axis=1, keepdims=True)
        return self.weights


@dataclass(frozen=True)
class Measured:
    """Statistics of a recording by the name of their quantity, and two of its pictures.

    Attributes:
        name: Of the recording.
        frames: Number of frames that were used.
        statistics: Those that could be computed, by the names in QUANTITIES.
        pictures: (H, W) uint8 left images, in order of time.
        landmarks: (N, 3) columns, rows and disparities of landmarks, px.
        steps_m: (M,) distances between the estimated poses of successive frames, m.
        turns: (M,) turns about the image's vertical between these poses, radians.
        baseline_m: Of the calibration.
    """

    name: str
    frames: int
    statistics: Mapping[str, Statistic]
    pictures: tuple[Array, ...] = field(default=(), repr=False)
    landmarks: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    steps_m: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    turns: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    baseline_m: float = np.nan

    def estimate(self, name: str) -> Array | None:
        """Return the estimate (B,) of a quantity over all frames; None if there is too little."""
        found = self.statistics.get(name)
        if found is None or not found.is_enough(QUANTITIES[name]):
            return None
        return found.pooled(np.ones((1, self.frames)))[0]
