"""Tables, verdict and figure of the study of urgent vehicles in simulated traffic."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, mean_interval
from trials.report.figure import shared_legend, tidy
from trials.report.tables import write_csv
from trials.routing.drive import STRATEGIES, Strategy
from trials.routing.figures import STYLES
from trials.routing.grid_study import Outcome
from trials.routing.network import large_network
from trials.routing.study import Verdict, random_case, randomised
from vo.contract.arrays import Array

Value = Callable[[Outcome], float]
BOTH = Strategy(dynamic=True, clearing=True)
NEITHER = Strategy(dynamic=False, clearing=False)
HEADER = (
    "strategy", "arrived", "travel time, s", "others, s", "added, s", "recovered", "after, s",
)  # fmt: skip
MODEL_DRIVES, MODEL_SHARE, MODEL_LEAD_S = 300, 0.25, 30.0
"""Random drives of the model beside those of the simulation, as `driftyard route` makes them."""


def name_of(strategy: Strategy) -> str:
    """Name of a strategy; in the simulation, nodes are cleared by preemption of their signals."""
    return strategy.name.replace("clearing", "preemption")


@dataclass(frozen=True)
class Results:
    """Outcomes of a study."""

    outcomes: Sequence[Outcome]

    @property
    def volumes(self) -> tuple[float, ...]:
        """Vehicles that enter at every entry in an hour, ascending."""
        return tuple(sorted({x.per_hour for x in self.outcomes}))

    def of(self, strategy: Strategy, volume: float) -> list[Outcome]:
        """Outcomes of a strategy at a volume, by seed."""
        chosen = [x for x in self.outcomes if (x.strategy, x.per_hour) == (strategy, volume)]
        return sorted(chosen, key=lambda x: x.seed)

    def values(self, strategy: Strategy, volume: float, value: Value) -> Array:
        """(seeds,) values of a strategy at a volume."""
        return np.array([value(x) for x in self.of(strategy, volume)])

    def added(self, strategy: Strategy, other: Strategy, volume: float, value: Value) -> Array:
        """(seeds,) differences of a strategy from another one in the same traffic."""
        return self.values(strategy, volume, value) - self.values(other, volume, value)


def travel_s(outcome: Outcome) -> float:
    """Travel time; of a vehicle that did not arrive, the time until the end."""
    return outcome.travel_s


def increase_percent(outcome: Outcome) -> float:
    """Increase of the travel time over the undelayed one."""
    return 100 * (outcome.travel_s / outcome.undelayed_s - 1)


def others_s(outcome: Outcome) -> float:
    """Mean delay of the other vehicles."""
    return outcome.others_delay_s


def recovery_s(outcome: Outcome) -> float:
    """Mean time until a signal has recovered, of those that have; NaN if there is none."""
    known = [x for x in outcome.recoveries_s if np.isfinite(x)]
    return float(np.mean(known)) if known else np.nan


def rows(results: Results, volume: float) -> list[tuple[str, ...]]:
    """Rows of the table of a volume, one for each strategy, as HEADER; intervals of 95 %.

    The columns are the mean delay of the other vehicles, what is added to it in the same traffic
    over static routing without preemption, and how many preempted signals have recovered, in which
    mean time after their release.
    """
    found: list[tuple[str, ...]] = []
    for strategy in STRATEGIES:
        drives = results.of(strategy, volume)
        signals = [x for drive in drives for x in drive.recoveries_s]
        added = mean_interval(results.added(strategy, NEITHER, volume, others_s))
        after = mean_interval(results.values(strategy, volume, recovery_s), minimum=0)
        found.append(
            (
                name_of(strategy),
                f"{sum(x.has_arrived for x in drives)}/{len(drives)}",
                mean_interval(results.values(strategy, volume, travel_s)).text(0),
                f"{results.values(strategy, volume, others_s).mean():.1f}",
                "–" if strategy == NEITHER else added.text(1),
                f"{int(np.isfinite(signals).sum())}/{len(signals)}" if signals else "–",
                after.text(0),
            )
        )
    return found


def hypothesis(results: Results) -> Verdict:
    """Test whether dynamic routing with preemption is faster than each of the other strategies.

    The mean over the volumes is one value of a seed; it holds if the intervals of all three paired
    differences are below 0.
    """
    saved = {other: saved_s(results, other) for other in STRATEGIES if other != BOTH}
    parts = [f"{name_of(other)} by {interval.text(1)} s" for other, interval in saved.items()]
    return Verdict(
        "dynamic routing with preemption is faster than each other strategy",
        all(interval.low > 0 for interval in saved.values()),
        f"faster than {', '.join(parts)}; 95 % intervals of the difference in the same traffic",
    )


def saved_s(results: Results, other: Strategy) -> Interval:
    """Time that dynamic routing with preemption saves against another strategy."""
    added = [results.added(other, BOTH, volume, travel_s) for volume in results.volumes]
    return mean_interval(np.mean(added, axis=0))


def model_increases() -> Mapping[Strategy, Interval]:
    """Increase over the undelayed time in the model's random drives with seed 0, %."""
    rng = np.random.default_rng(0)
    network = large_network(rng)
    cases = [random_case(network, MODEL_SHARE, rng) for _ in range(MODEL_DRIVES)]
    drives = randomised(network, cases, MODEL_LEAD_S, rng, lambda _: None)
    return dict(zip(STRATEGIES, map(mean_interval, drives.increase_percent), strict=True))


def draw(figure: Figure, results: Results) -> None:
    """Draw travel time, delay added to the others, and the increase beside that of the model."""
    panels = figure.subplots(1, 3)
    gap = 0.03 * np.ptp(results.volumes) or 1.0
    for k, (strategy, (colour, style)) in enumerate(zip(STRATEGIES, STYLES, strict=True)):
        at = np.array(results.volumes) + (k - 1.5) * gap
        travel = [results.values(strategy, volume, travel_s) for volume in results.volumes]
        added = [results.added(strategy, NEITHER, volume, others_s) for volume in results.volumes]
        for panel, samples in ((panels[0], travel), (panels[1], added)):
            mean, low, high = np.transpose([astuple(mean_interval(x)) for x in samples])
            panel.errorbar(
                at, mean, [mean - low, high - mean], color=colour, linestyle=style, marker=".",
                capsize=3, label=name_of(strategy),
            )  # fmt: skip
    titles = ("travel time of the urgent vehicle", "delay added to every other vehicle")
    for panel, title in zip(panels, titles, strict=False):
        tidy(panel, "vehicles an hour at every entry", "s", title)
        panel.set_xticks(results.volumes)
    panels[0].set_ylim(bottom=0)
    _draw_increases(panels[2], results)
    shared_legend(figure, [*panels])


def _draw_increases(panel: Axes, results: Results) -> None:
    """Draw the increase over the undelayed time: of the model white, of the simulation full."""
    model = model_increases()
    for k, (strategy, (colour, _)) in enumerate(zip(STRATEGIES, STYLES, strict=True)):
        each = [results.values(strategy, volume, increase_percent) for volume in results.volumes]
        simulated = mean_interval(np.mean(each, axis=0))
        for at, x, face in ((k - 0.15, model[strategy], "white"), (k + 0.15, simulated, colour)):
            ends = [[x.value - x.low], [x.high - x.value]]
            panel.errorbar(at, x.value, ends, fmt="D", color=colour, mfc=face, capsize=3)
            panel.annotate(
                f"{x.value:.0f}", (at, x.value), (5, 4), textcoords="offset points", fontsize=8
            )
    panel.set_xticks(range(4), [name_of(x).replace(" + ", "\n+ ") for x in STRATEGIES])
    panel.set_ylim(bottom=0)
    panel.margins(x=0.1)
    tidy(panel, "", "%", "increase over undelayed; white: the model")


def write_outcomes(out: Path, results: Results) -> None:
    """Write one row for each drive as CSV."""
    header = (
        "vehicles_per_hour", "seed", "strategy", "travel_s", "arrived", "undelayed_s",
        "others_delay_s", "moved_out_of_jams", "preempted", "recovery_s",
    )  # fmt: skip
    lines = [
        (
            f"{x.per_hour:g}", x.seed, name_of(x.strategy), f"{x.travel_s:.0f}", int(x.has_arrived),
            f"{x.undelayed_s:.1f}", f"{x.others_delay_s:.2f}", x.jams, x.preempted,
            f"{recovery_s(x):.1f}" if x.recoveries_s else "",
        )
        for x in results.outcomes
    ]  # fmt: skip
    write_csv(out, header, lines)
