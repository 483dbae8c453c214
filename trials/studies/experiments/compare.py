"""Several variants beside a reference, pair by pair over the same recordings."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval, mean_interval, ratio_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import GREY, INK, RED, tidy
from trials.studies.experiments.experiment import TableOf
from trials.studies.experiments.sweep import lost_percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def ratios(
    results: Results, variants: Sequence[Variant], reference: Variant
) -> dict[Variant, Interval]:
    """Geometric mean of each variant's drift over the reference's, with its interval."""
    known = results.drifts(reference)
    return {v: ratio_interval(results.drifts(v), known) for v in variants}


def comparison_table(
    results: Results, variants: Sequence[Variant], reference: Variant, heading: str
) -> TableOf:
    """A row for the reference and each variant: drift, ratio, lost frames, time."""
    found = ratios(results, variants, reference)
    rows = [
        (
            variant.label,
            mean_interval(results.drifts(variant), least=0).text(3),
            "1" if variant == reference else found[variant].text(2),
            f"{lost_percent(results, variant):.1f}",
            f"{np.mean([np.median(x.frames.frame_ms) for x in results.of(variant)]):.0f}",
        )
        for variant in (reference, *variants)
    ]
    columns = (heading, "drift over 1 m, %", "ratio", "frames lost, %", "ms a frame")
    return TableOf(columns, tuple(rows))


def comparison_data(
    results: Results, variants: Sequence[Variant], reference: Variant
) -> dict[str, np.ndarray]:
    """A column of drifts for the reference and each variant, a row for each recording."""
    return {f"{v.label}, %": results.drifts(v) for v in (reference, *variants)}


def draw_ratios(
    figure: "Figure", results: Results, variants: Sequence[Variant], reference: Variant
) -> None:
    """Every variant's ratio with its interval, one below the other; dots are recordings."""
    panel = figure.subplots()
    known = results.drifts(reference)
    for row, (variant, found) in enumerate(ratios(results, variants, reference).items()):
        with np.errstate(divide="ignore", invalid="ignore"):
            each = results.drifts(variant) / known
        panel.plot(each, np.full(len(each), row), "o", color=GREY, ms=3, alpha=0.6)
        panel.plot([found.low, found.high], [row, row], color=RED, lw=2.0)
        panel.plot(found.value, row, "D", color=RED, ms=5)
    panel.axvline(1.0, color=INK, ls="--", lw=0.9)
    panel.set_xscale("log")
    panel.set_yticks(range(len(variants)), [v.label for v in variants])
    panel.set_ylim(len(variants) - 0.5, -0.5)
    tidy(panel, f"drift, ratio to {reference.label} (1: no difference; left is better)", "")
    panel.tick_params(axis="y", labelsize=8.5)
    panel.xaxis.set_major_formatter("{x:g}")
