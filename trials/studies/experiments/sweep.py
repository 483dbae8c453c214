"""One setting over many values: how inliers and drift follow it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval, mean_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.experiment import TableOf

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Sweep = Mapping[float, Variant]
"""A variant for each value of a setting."""


def median_count(results: Results, variant: Variant, stage: str) -> np.ndarray:
    """Median over frames (N,) of what survives a stage, for each run of a variant."""
    return np.array([np.nanmedian(x.frames.counts[stage]) for x in results.of(variant)])


def lost_percent(results: Results, variant: Variant) -> float:
    """Share of frames without a pose over all runs of a variant, %."""
    return 100 * float(np.mean([x.lost_share for x in results.of(variant)]))


def levels(results: Results, sweep: Sweep, stage: str) -> dict[float, tuple[Interval, Interval]]:
    """Mean survivors of a stage and mean drift at every value."""
    return {
        value: (
            mean_interval(median_count(results, variant, stage), least=0),
            mean_interval(results.drifts(variant), least=0),
        )
        for value, variant in sweep.items()
    }


def sweep_table(results: Results, sweep: Sweep, setting: str, stage: str, label: str) -> TableOf:
    """A row for every value.

    Args:
        results: Of all variants of the sweep.
        sweep: Value to variant.
        setting: Heading of the values.
        stage: Whose survivors are counted.
        label: Their heading.
    """
    found = levels(results, sweep, stage)
    rows = [
        (
            f"{value:g}",
            count.text(0),
            drift.text(3),
            f"{lost_percent(results, sweep[value]):.1f}",
        )
        for value, (count, drift) in found.items()
    ]
    return TableOf((setting, label, "drift over 1 m, %", "frames lost, %"), tuple(rows))


def sweep_data(results: Results, sweep: Sweep, setting: str, stage: str) -> dict[str, np.ndarray]:
    """Columns of value, survivors and drift, a row for every run."""
    runs = len(results.recordings)
    return {
        setting: np.repeat(list(sweep), runs),
        stage: np.concatenate([median_count(results, v, stage) for v in sweep.values()]),
        "drift over 1 m, %": np.concatenate([results.drifts(v) for v in sweep.values()]),
    }


def draw_sweep(
    figure: "Figure", results: Results, sweep: Sweep, setting: str, stage: str, label: str
) -> None:
    """Survivors (left) and drift (right) over the setting; a line of means, a dot a run."""
    from matplotlib.ticker import LogLocator, NullLocator

    found = levels(results, sweep, stage)
    for k, (panel, heading, colour) in enumerate(
        zip(figure.subplots(1, 2), (label, "drift over 1 m, %"), (BLUE, RED), strict=True)
    ):
        panel.plot(list(found), [x[k].value for x in found.values()], color=colour, lw=1.5)
        for value, variant in sweep.items():
            runs = results.drifts(variant) if k else median_count(results, variant, stage)
            panel.plot(np.full(len(runs), value), runs, "o", color=colour, ms=3, alpha=0.5)
        panel.set_xscale("log")
        if k:
            panel.set_yscale("log")
            panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            panel.yaxis.set_major_formatter("{x:g}")
            panel.yaxis.set_minor_locator(NullLocator())
        else:
            panel.set_ylim(bottom=0)
        tidy(panel, setting, heading)
