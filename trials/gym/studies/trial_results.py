"""Results of trials by source of localization: their metrics, and their figure.

Sources: Anderson et al., On Evaluation of Embodied Navigation Agents, 2018 (SPL; soft SPL weighs
progress where SPL asks for success); Xiao et al., Autonomous Ground Navigation in Highly
Constrained Spaces (the BARN challenge), 2022 (a score that rewards time against the optimal).
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from trials.evaluation.intervals import CONFIDENCE, Interval, mean_interval
from trials.gym.env.localization import DRIFT
from trials.report.figure import GREY, SERIES, tidy

BARN_LIMITS = np.array([2.0, 8.0])
"""Multiples of the optimal time between which BARN's score falls as 1 / time."""
MIN_PERCENT = 0.005
"""Left end of the logarithmic axis; less drift, such as that of the truth, is drawn here, and the
legend says so."""


@dataclass(frozen=True)
class Result:
    """Result of any trial.

    Attributes:
        layout: Seed of the world.
        run: Number of start and goal in it.
        localization: Source of the pose.
        outcome: success, collision, fell, tipped, stuck, lost or timeout.
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
    def success(self) -> bool:
        """Whether the task was done."""
        return self.outcome == "success"


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
        time_s = float(np.clip(self.time_s, *(BARN_LIMITS * self.optimal_s)))
        return self.success * self.optimal_s / time_s


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


def outcome_interval(results: Sequence[Result], outcome: str) -> Interval:
    """Proportion of trials with an outcome, with Wilson's interval; at least one trial."""
    count = sum(x.outcome == outcome for x in results)
    wilson = stats.binomtest(count, len(results)).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(count / len(results), float(wilson.low), float(wilson.high))


def summarize(results: Sequence[R], metrics: Metrics[R]) -> dict[str, str]:
    """Format outcomes and metrics of one group of results with their intervals."""
    found = {
        "success": outcome_interval(results, "success").text(2),
        "collisions": outcome_interval(results, "collision").text(2),
    }
    for name, (metric, digits) in metrics.items():
        found[name] = mean_interval(np.array([metric(x) for x in results])).text(digits)
    return found


def json_lines(results: Iterable[Result]) -> str:
    """Format results as JSON, one a line."""
    return "".join(json.dumps(asdict(result)) + "\n" for result in results)


def draw_sensitivity(figure: Figure, by_source: Mapping[str, Sequence[TrialResult]]) -> None:
    """Draw success and collisions over the median drift; `drift:...` are joined by a line."""
    drifts: dict[str, float] = {}
    for source, results in by_source.items():
        known = [x.drift_percent for x in results if x.drift_percent is not None]
        drifts[source] = max(float(np.median(known)) if known else math.nan, MIN_PERCENT)
    injected = sorted((x for x in by_source if x.startswith(DRIFT)), key=lambda x: drifts[x])
    groups = [(injected, GREY, "o-", "injected")] if injected else []
    for source, colour in zip((x for x in by_source if x not in injected), SERIES, strict=False):
        below = "" if drifts[source] > MIN_PERCENT else f" (below {MIN_PERCENT:g} %)"
        groups.append(([source], colour, "D", source + below))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, outcome in zip(panels, ("success", "collision"), strict=True):
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(lambda percent, _: f"{percent:g}")
        for sources, colour, style, label in groups:
            intervals = [astuple(outcome_interval(by_source[x], outcome)) for x in sources]
            values, low, high = np.transpose(intervals)
            panel.errorbar(
                [drifts[x] for x in sources], values, (values - low, high - values), fmt=style,
                color=colour, markersize=5, capsize=3, linewidth=1.3, label=label,
            )  # fmt: skip
    tidy(panels[0], "drift over 1 m, median of trials (%)", "share of trials", "Success")
    tidy(panels[1], "drift over 1 m, median of trials (%)", "", "Collisions")
    panels[0].set_ylim(-0.03, 1.03)
    panels[0].legend(loc="lower left")
