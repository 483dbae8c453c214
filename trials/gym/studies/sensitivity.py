"""The sensitivity curve: how often a rover arrives, by how much its localization drifts."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval
from trials.gym.env.localization import DRIFT
from trials.gym.studies.trial_protocol import Trial, share_interval
from trials.report.figure import GREY, SERIES, tidy
from vo.contract.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_PERCENT = 0.005
"""Less drift, such as that of the truth, is drawn here, and the legend says so: the axis is
logarithmic."""


def drift_of(of_source: Sequence[Trial]) -> float:
    """Median over trials of the drift over 1 m, in per cent; NaN if none drove so far."""
    known = [x.drift_percent for x in of_source if x.drift_percent is not None]
    return float(np.median(known)) if known else math.nan


def draw_sensitivity(figure: "Figure", by_source: Mapping[str, Sequence[Trial]]) -> None:
    """Draw success and collisions over the drift that each source was found to have.

    Args:
        figure: Empty.
        by_source: Trials of every source; those called `drift:...` are joined by a line.
    """
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw(panels[0], by_source, lambda x: x.success)
    _draw(panels[1], by_source, lambda x: x.collision)
    tidy(panels[0], "drift over 1 m, median of trials (%)", "share of trials", "Success")
    tidy(panels[1], "drift over 1 m, median of trials (%)", "", "Collisions")
    panels[0].set_ylim(-0.03, 1.03)
    panels[0].legend(fontsize=8, loc="lower left", frameon=False)


def _draw(
    panel: "Axes", by_source: Mapping[str, Sequence[Trial]], counted: Callable[[Trial], float]
) -> None:
    shares = {
        source: share_interval(np.array([counted(x) for x in trials]))
        for source, trials in by_source.items()
    }
    places = {x: max(drift_of(trials), LEAST_PERCENT) for x, trials in by_source.items()}
    injected = sorted((x for x in shares if x.startswith(DRIFT)), key=lambda x: places[x])
    panel.set_xscale("log")
    panel.xaxis.set_major_formatter(lambda percent, _: f"{percent:g}")
    if injected:
        _mark(
            panel,
            [places[x] for x in injected],
            [shares[x] for x in injected],
            GREY,
            "o-",
            "injected",
        )
    for source, colour in zip((x for x in shares if x not in injected), SERIES, strict=False):
        label = (
            source if places[source] > LEAST_PERCENT else f"{source} (below {LEAST_PERCENT:g} %)"
        )
        _mark(panel, [places[source]], [shares[source]], colour, "D", label)


def _mark(
    panel: "Axes", x: list[float], shares: list[Interval], colour: str, style: str, label: str
) -> None:
    values: Array = np.array([s.value for s in shares])
    reach = np.abs(np.array([[s.low, s.high] for s in shares]).T - values)
    panel.errorbar(
        x, values, reach, fmt=style, color=colour, markersize=5, capsize=3, linewidth=1.3,
        label=label,
    )  # fmt: skip
