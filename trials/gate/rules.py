"""What counts as a regression; kept in the baseline, where a review sees it."""

from typing import Self

from pydantic import Field, model_validator

from vo.contract.settings import Settings


class Rules(Settings):
    """Level, power, and relative increases; time or NEES with a margin of 0 is not gated."""

    level: float = Field(default=0.05, gt=0, le=0.2)
    """Probability that an estimator which drifts more by the tolerance is called a regression."""
    power: float = Field(default=0.8, ge=0.5, lt=1)
    """Probability with which the smallest detectable change is found."""
    drift_tolerance: float = Field(default=0.005, ge=0, le=10)
    """Drift that is certain to have grown by more than this is a regression."""
    drift_margin: float = Field(default=0.1, gt=0, le=10)
    """Drift that is certain to have grown by less than this passes."""
    time_margin: float = Field(default=0.25, ge=0, le=10)
    """Both for the time of a frame over the reference's."""
    nees_margin: float = Field(default=0.5, ge=0, le=10)
    """Both for the distance of the NEES from its expectation."""

    @model_validator(mode="after")
    def _margin_is_beyond_tolerance(self) -> Self:
        if self.drift_margin <= self.drift_tolerance:
            raise ValueError("drift_margin: must exceed drift_tolerance")
        return self
