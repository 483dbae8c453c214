"""Confidence intervals of small samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from vo.contract.arrays import Array

CONFIDENCE, RESAMPLES = 0.95, 2000


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


def median_interval(drives: Sequence[Array]) -> Interval:
    """Return the median over drives of the median over repeated runs, with a bootstrap interval.

    Each drive has (R,) values, R >= 1. Drives are resampled, and the runs of each, since both vary;
    without a second value there is no interval.

    Source:
        Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8, for
        hierarchical data; percentile interval of Efron and Tibshirani, 1993, chapter 13.
    """
    if not drives:
        return Interval(np.nan, np.nan, np.nan)
    value = float(np.median([np.median(x) for x in drives]))
    if sum(map(len, drives)) == 1:
        return Interval(value, np.nan, np.nan)
    rng = np.random.default_rng(0)
    medians = np.array([np.median(rng.choice(x, (RESAMPLES, len(x))), axis=1) for x in drives])
    chosen = rng.integers(len(drives), size=(RESAMPLES, len(drives)))
    runs = rng.integers(RESAMPLES, size=chosen.shape)
    found = np.median(medians[chosen, runs], axis=1)
    low, high = np.quantile(found, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(value, float(low), float(high))
