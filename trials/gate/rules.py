"""Rules of the decision, stored in the baseline."""

from typing import Self

from pydantic import Field, model_validator

from vo.contract.settings import Settings


class Rules(Settings):
    """Level, power, and relative increases; a margin of 0 disables time or NEES."""

    level: float = Field(default=0.05, gt=0, le=0.2)
    """False alarm rate for an estimator whose drift grew by the tolerance."""
    power: float = Field(default=0.8, ge=0.5, lt=1)
    """Probability of finding the smallest detectable change."""
    drift_tolerance: float = Field(default=0.005, ge=0, le=10)
    """Relative increase of drift; a regression if the lower confidence bound exceeds it."""
    drift_margin: float = Field(default=0.1, gt=0, le=10)
    """Relative increase of drift; a pass if the upper confidence bound is below it."""
    time_margin: float = Field(default=0.25, ge=0, le=10)
    """Tolerance and margin of the frame time over that of the reference estimator."""
    nees_margin: float = Field(default=0.5, ge=0, le=10)
    """Tolerance and margin of the distance of the NEES from its expectation."""

    @model_validator(mode="after")
    def _margin_is_beyond_tolerance(self) -> Self:
        if self.drift_margin <= self.drift_tolerance:
            raise ValueError("drift_margin: must exceed drift_tolerance")
        return self
