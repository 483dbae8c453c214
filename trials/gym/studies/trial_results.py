"""Results of trials and their metrics: the same starts and goals for every source of localization.

Sources: Anderson et al., On Evaluation of Embodied Navigation Agents, 2018 (SPL; soft SPL weighs
progress where SPL asks for success); Xiao et al., Autonomous Ground Navigation in Highly
Constrained Spaces (the BARN challenge), 2022 (a score that rewards time against the optimal).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy import stats

from trials.evaluation.intervals import CONFIDENCE, Interval, mean_interval
from vo.contract.arrays import Array

FASTEST, SLOWEST = 2.0, 8.0
"""Multiples of the optimal time between which BARN's score falls as 1 / time."""


@dataclass(frozen=True)
class Result:
    """Result of any trial.

    Attributes:
        layout: Seed of the world.
        run: Number of start and goal in it.
        localization: Source of the pose.
        outcome: success, collision, tipped, stuck, lost or timeout.
        time_s: Duration.
        driven_m: Length of the true path.
        way_m: Length of the shortest path in the world as it was built.
    """

    layout: int
    run: int
    localization: str
    outcome: str
    time_s: float
    driven_m: float
    way_m: float

    @property
    def success(self) -> float:
        """1 or 0."""
        return float(self.outcome == "success")

    @property
    def collision(self) -> float:
        """1 or 0."""
        return float(self.outcome == "collision")


@dataclass(frozen=True)
class TrialResult(Result):
    """Result of a trial with a source of localization.

    Attributes:
        left_m: Length of the path that remained.
        optimal_s: Time for the shortest path at full speed.
        error_m: Position error of the localization at the end.
        drift_percent: Mean drift of the localization over 1 m; None if less was driven.
        lost_share: Fraction of steps without a pose.
    """

    left_m: float
    optimal_s: float
    error_m: float
    drift_percent: float | None
    lost_share: float

    @property
    def spl(self) -> float:
        """Success weighted by path length."""
        return self.success * self.way_m / max(self.way_m, self.driven_m)

    @property
    def soft_spl(self) -> float:
        """Progress weighted by path length."""
        progress = 1.0 if self.success else max(0.0, 1 - self.left_m / self.way_m)
        return progress * self.way_m / max(self.way_m, self.driven_m)

    @property
    def barn(self) -> float:
        """Success times the optimal time over the time, the latter within 2 to 8 optimal ones."""
        limits = FASTEST * self.optimal_s, SLOWEST * self.optimal_s
        return self.success * self.optimal_s / float(np.clip(self.time_s, *limits))


R = TypeVar("R", bound=Result)
Metrics = Mapping[str, tuple[Callable[[R], float], int]]
"""Name to the metric of a result and its digits in a table."""

METRICS: Metrics[TrialResult] = {
    "SPL": (lambda t: t.spl, 2),
    "soft SPL": (lambda t: t.soft_spl, 2),
    "BARN score": (lambda t: t.barn, 2),
    "left m": (lambda t: t.left_m, 2),
    "time s": (lambda t: t.time_s, 1),
    "driven m": (lambda t: t.driven_m, 2),
    "error m": (lambda t: t.error_m, 3),
    "drift over 1 m, %": (lambda t: math.nan if t.drift_percent is None else t.drift_percent, 3),
}


def proportion_interval(values: Array) -> Interval:
    """Proportion of ones among (N,) zeros and ones, with Wilson's interval; N >= 1."""
    n, p = len(values), float(np.mean(values))
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2))
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    reach = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return Interval(p, max(0.0, middle - reach), min(1.0, middle + reach))


def summarize(results: Sequence[R], metrics: Metrics[R]) -> dict[str, str]:
    """Format outcomes and metrics of one group of results with their intervals."""
    proportions = {
        name: proportion_interval(np.array(values)).text(2)
        for name, values in (
            ("success", [x.success for x in results]),
            ("collisions", [x.collision for x in results]),
        )
    }
    means = {
        name: mean_interval(np.array([metric(x) for x in results])).text(digits)
        for name, (metric, digits) in metrics.items()
    }
    return {**proportions, **means}
