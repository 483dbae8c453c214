"""Sensitivity curve: success and collisions over the drift of the localization."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple

import numpy as np
from matplotlib.figure import Figure

from trials.gym.env.localization import DRIFT
from trials.gym.studies.trial_results import TrialResult, outcome_interval
from trials.report.figure import GREY, SERIES, tidy

MIN_PERCENT = 0.005
"""Left end of the logarithmic axis; less drift, such as that of the truth, is drawn here, and the
legend says so."""


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
