"""Figures of one estimator on one sequence."""

import math

from pydantic import Field

from vo.contract.settings import Settings

MAX_LOST_RATIO = 0.02
"""Ratio of lost frames above which a sequence counts as lost."""
MIN_DRIFT_PERCENT = 1e-4
"""Smallest drift; smaller ones count as this, so that the logarithm is finite."""


class Measurement(Settings):
    """Figures of one estimator on one sequence."""

    frames: int = Field(ge=1)
    """Number of frames."""
    lost_frames: int = Field(ge=0)
    """Number of frames without a pose."""
    drift_percent: float | None = Field(default=None, ge=0)
    """Mean translation error over 1 m; none with too few poses."""
    frame_ms: float | None = Field(default=None, gt=0)
    """Median wall time of a frame."""
    reference_ms: float | None = Field(default=None, gt=0)
    """Median wall time of a frame of the reference estimator."""
    nees: float | None = Field(default=None, gt=0)
    """Median NEES of steps over its expected median; none without covariances."""
    problem: str = ""
    """Error of the estimator; empty if it succeeded."""

    @property
    def is_lost(self) -> bool:
        """Whether too many frames are lost, or the drift is undefined."""
        return self.drift_percent is None or self.lost_frames > MAX_LOST_RATIO * self.frames

    @property
    def log_drift(self) -> float:
        """Logarithm of the drift in percent; NaN if lost."""
        if self.is_lost or self.drift_percent is None:
            return math.nan
        return math.log(max(self.drift_percent, MIN_DRIFT_PERCENT))

    @property
    def log_time(self) -> float:
        """Logarithm of the frame time over that of the reference; NaN if unknown."""
        if self.frame_ms is None or self.reference_ms is None:
            return math.nan
        return math.log(self.frame_ms / self.reference_ms)

    @property
    def log_nees(self) -> float:
        """Logarithm of the NEES over its expectation, 0 if consistent; NaN if unknown."""
        return math.nan if self.nees is None else math.log(self.nees)
