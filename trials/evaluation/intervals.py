"""Confidence intervals of few values."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from vo.contract.arrays import Array

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and the ends of its confidence interval; NaN where there are too few values."""

    value: float
    low: float
    high: float

    def text(self, digits: int = 3) -> str:
        """Such as `0.123 (0.101 to 0.145)`."""
        if not np.isfinite(self.value):
            return "–"
        if not np.isfinite(self.low):
            return f"{self.value:.{digits}f}"
        return f"{self.value:.{digits}f} ({self.low:.{digits}f} to {self.high:.{digits}f})"


def mean_interval(values: Array, least: float = -np.inf, most: float = np.inf) -> Interval:
    """Mean of (N,) values with Student's interval; values that are NaN are left out.

    Args:
        values: (N,).
        least: Below which no value can be; the interval ends there.
        most: Above which none can be.
    """
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return Interval(np.nan, np.nan, np.nan)
    mean = float(np.mean(known))
    if len(known) == 1:
        return Interval(mean, np.nan, np.nan)
    reach = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(known) - 1) * stats.sem(known))
    return Interval(mean, max(mean - reach, least), min(mean + reach, most))


def ratio_interval(values: Array, references: Array) -> Interval:
    """Geometric mean of (N,) paired ratios, with Student's interval of their logarithms.

    A pair of which one is not finite and positive is left out.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(values) - np.log(references)
    found = mean_interval(np.where(np.isfinite(logs), logs, np.nan))
    return Interval(*(float(np.exp(x)) for x in (found.value, found.low, found.high)))
