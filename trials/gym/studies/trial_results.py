"""The trial protocol: many worlds, the same starts and goals for every source of localization.

Sources: Anderson et al., On Evaluation of Embodied Navigation Agents, 2018 (SPL; soft SPL weighs
progress where SPL asks for success); Xiao et al., Autonomous Ground Navigation in Highly
Constrained Spaces (the BARN challenge), 2022 (a score that rewards time against the optimal).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from scipy import stats

from trials.evaluation.intervals import CONFIDENCE, Interval, mean_interval
from vo.contract.arrays import Array

FASTEST, SLOWEST = 2.0, 8.0
"""Multiples of the optimal time between which BARN's score falls as 1 / time."""


@dataclass(frozen=True)
class Trial:
    """What came of one trial.

    Attributes:
        layout: Seed of the world.
        run: Number of start and goal in it.
        localization: Source.
        outcome: success, collision, tipped, stuck, lost or timeout.
        time_s: That it took.
        driven_m: True path.
        way_m: Shortest way.
        left_m: Way that was left.
        optimal_s: Time for the shortest way at full speed.
        error_m: Of the localization at the end.
        drift_percent: Of the localization over 1 m, mean; None if less was driven.
        lost_share: Of steps without a pose.
    """

    layout: int
    run: int
    localization: str
    outcome: str
    time_s: float
    driven_m: float
    way_m: float
    left_m: float
    optimal_s: float
    error_m: float
    drift_percent: float | None
    lost_share: float

    @property
    def success(self) -> float:
        """1 or 0."""
        return float(self.outcome == "success")

    @property
    def collision(self) -> float:
        """1 or 0."""
        return float(self.outcome == "collision")

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


class Ended(Protocol):
    """Any trial that came to an outcome."""

    @property
    def outcome(self) -> str:
        """success, collision, tipped, stuck, lost or timeout."""
        ...


T = TypeVar("T", bound=Ended)
Measures = Mapping[str, tuple[Callable[[T], float], int]]
"""Name to the measure of a trial and the digits worth printing."""

MEASURES: Measures[Trial] = {
    "SPL": (lambda t: t.spl, 2),
    "soft SPL": (lambda t: t.soft_spl, 2),
    "BARN score": (lambda t: t.barn, 2),
    "left m": (lambda t: t.left_m, 2),
    "time s": (lambda t: t.time_s, 1),
    "driven m": (lambda t: t.driven_m, 2),
    "error m": (lambda t: t.error_m, 3),
    "drift over 1 m, %": (lambda t: math.nan if t.drift_percent is None else t.drift_percent, 3),
}


def share_interval(values: Array) -> Interval:
    """Share of ones among (N,) zeros and ones, with Wilson's interval; N >= 1."""
    n, share = len(values), float(np.mean(values))
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2))
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    reach = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Interval(share, max(0.0, middle - reach), min(1.0, middle + reach))


def summary(trials_of_one: Sequence[T], measures: Measures[T]) -> dict[str, str]:
    """Outcomes and measures with their intervals, as text, of the trials of one source."""
    outcomes: Array = np.array([t.outcome for t in trials_of_one])
    shares = {
        name: share_interval((outcomes == outcome).astype(float)).text(2)
        for name, outcome in (("success", "success"), ("collisions", "collision"))
    }
    means = {
        name: mean_interval(np.array([measure(t) for t in trials_of_one])).text(digits)
        for name, (measure, digits) in measures.items()
    }
    return {**shares, **means}
