"""Sensitivity curve: success and collisions over the drift of the localization."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.gym.env.localization import DRIFT
from trials.gym.studies.trial_results import TrialResult, proportion_interval
from trials.report.figure import GREY, SERIES, tidy
from vo.contract.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MIN_PERCENT = 0.005
"""Left end of the logarithmic axis; less drift, such as that of the truth, is drawn here, and the
legend says so."""


def median_drift(results: Sequence[TrialResult]) -> float:
    """Median of the drift over 1 m, in per cent; NaN if no trial drove so far."""
    known = [x.drift_percent for x in results if x.drift_percent is not None]
    return float(np.median(known)) if known else math.nan


def draw_sensitivity(figure: "Figure", by_source: Mapping[str, Sequence[TrialResult]]) -> None:
    """Draw success and collisions over the measured drift; `drift:...` are joined by a line."""
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw(panels[0], by_source, lambda x: x.success)
    _draw(panels[1], by_source, lambda x: x.collision)
    tidy(panels[0], "drift over 1 m, median of trials (%)", "share of trials", "Success")
    tidy(panels[1], "drift over 1 m, median of trials (%)", "", "Collisions")
    panels[0].set_ylim(-0.03, 1.03)
    panels[0].legend(fontsize=8, loc="lower left", frameon=False)


def _draw(
    panel: "Axes",
    by_source: Mapping[str, Sequence[TrialResult]],
    counted: Callable[[TrialResult], float],
) -> None:
    proportions = {
        source: proportion_interval(np.array([counted(x) for x in results]))
        for source, results in by_source.items()
    }
    drifts = {x: max(median_drift(results), MIN_PERCENT) for x, results in by_source.items()}
    injected = sorted((x for x in by_source if x.startswith(DRIFT)), key=lambda x: drifts[x])
    panel.set_xscale("log")
    panel.xaxis.set_major_formatter(lambda percent, _: f"{percent:g}")
    groups = [(injected, GREY, "o-", "injected")] if injected else []
    for source, colour in zip((x for x in by_source if x not in injected), SERIES, strict=False):
        below = "" if drifts[source] > MIN_PERCENT else f" (below {MIN_PERCENT:g} %)"
        groups.append(([source], colour, "D", source + below))
    for sources, colour, style, label in groups:
        values: Array = np.array([proportions[x].value for x in sources])
        ends = np.array([[proportions[x].low, proportions[x].high] for x in sources]).T
        panel.errorbar(
            [drifts[x] for x in sources], values, np.abs(ends - values), fmt=style, color=colour,
            markersize=5, capsize=3, linewidth=1.3, label=label,
        )  # fmt: skip
