"""Confidence intervals of small samples."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from vo.contract.arrays import Array

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """Estimate with the ends of its confidence interval; NaN if there are too few values."""

    value: float
    low: float
    high: float

    def text(self, digits: int = 3) -> str:
        """Format as `0.123 (0.101 to 0.145)`."""
        if not np.isfinite(self.value):
            return "–"
        if not np.isfinite(self.low):
            return f"{self.value:.{digits}f}"
        return f"{self.value:.{digits}f} ({self.low:.{digits}f} to {self.high:.{digits}f})"


def mean_interval(values: Array, minimum: float = -np.inf, maximum: float = np.inf) -> Interval:
    """Return the mean of (N,) values with Student's interval, clipped to the possible range.

    NaN is ignored.
    """
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return Interval(np.nan, np.nan, np.nan)
    mean = float(np.mean(known))
    if len(known) == 1:
        return Interval(mean, np.nan, np.nan)
    half_width = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(known) - 1) * stats.sem(known))
    return Interval(mean, max(mean - half_width, minimum), min(mean + half_width, maximum))


def ratio_interval(values: Array, references: Array) -> Interval:
    """Return the geometric mean of (N,) paired ratios with Student's interval of their logarithms.

    Pairs with a value that is not finite and positive are ignored.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(values) - np.log(references)
    found = mean_interval(np.where(np.isfinite(logs), logs, np.nan))
    return Interval(*(float(np.exp(x)) for x in (found.value, found.low, found.high)))
