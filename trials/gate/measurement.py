"""What one estimator did on one sequence, in the few figures that are gated."""

import math

from pydantic import Field

from vo.contract.settings import Settings

LOST_SHARE = 0.02
"""A sequence with more frames lost than this counts as lost."""
FLOOR_PERCENT = 1e-4
"""Drift below a micrometre in a metre is as good as this: a logarithm wants more than nothing."""


class Measurement(Settings):
    """One estimator on one sequence."""

    frames: int = Field(ge=1)
    lost_frames: int = Field(ge=0)
    drift_percent: float | None = Field(default=None, ge=0)
    """Mean translation error over 1 m; none where there are too few poses to say."""
    frame_ms: float | None = Field(default=None, gt=0)
    """Median wall time of a frame."""
    reference_ms: float | None = Field(default=None, gt=0)
    """The same of the reference estimator, run just before."""
    nees: float | None = Field(default=None, gt=0)
    """Median NEES of steps over what it is expected to be; none without covariances."""
    problem: str = ""
    """Why there is no result; empty if the estimator ran through."""

    @property
    def is_lost(self) -> bool:
        """Whether there is no drift worth speaking of."""
        return self.drift_percent is None or self.lost_frames > LOST_SHARE * self.frames

    @property
    def log_drift(self) -> float:
        """Logarithm of the drift in percent; NaN if lost."""
        if self.is_lost or self.drift_percent is None:
            return math.nan
        return math.log(max(self.drift_percent, FLOOR_PERCENT))

    @property
    def log_time(self) -> float:
        """Logarithm of the time over the reference's; NaN if unknown."""
        if self.frame_ms is None or self.reference_ms is None:
            return math.nan
        return math.log(self.frame_ms / self.reference_ms)

    @property
    def log_nees(self) -> float:
        """Logarithm of the NEES over its expectation, 0 if honest; NaN if unknown."""
        return math.nan if self.nees is None else math.log(self.nees)
