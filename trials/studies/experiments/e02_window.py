"""E2: local bundle adjustment is nearly as accurate as global, and much faster (thesis 4.2)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval, mean_interval, ratio_interval
from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.experiment import Experiment, Findings, Scale, TableOf, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENES = ("office", "brick_court")
LENGTH_M = 2.4
"""Global adjustment at every frame grows with the square of the frames and more."""
WINDOWS = (2, 4, 8, 16, 32)
ALL = 10_000
LOCAL = {
    window: Variant(f"last {window} frames", "thesis", (f"refinement.window={window}",))
    for window in WINDOWS
}
GLOBAL = Variant("all frames", "thesis", (f"refinement.window={ALL}",))
VARIANTS = (*LOCAL.values(), GLOBAL)
NEARLY = 1.2
"""Ratio of drifts up to which one is nearly as good as the other."""
MUCH = 3.0
"""Ratio of times from which on one is much faster."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Windows of several sizes, and all frames, at every frame."""
    short = replace(scale, distance_m=min(LENGTH_M, scale.distance_m))
    return jobs_of(short.recordings(SCENES), VARIANTS)


def analyse(results: Results) -> Findings:
    """Hold drift and time of every window against those of all frames."""
    reference_ms = _refinement_ms(results, GLOBAL)
    rows: list[tuple[str, ...]] = []
    drift: list[Interval] = []
    faster: list[Interval] = []
    for variant in VARIANTS:
        drift.append(ratio_interval(results.drifts(variant), results.drifts(GLOBAL)))
        faster.append(ratio_interval(reference_ms, _refinement_ms(results, variant)))
        rows.append(
            (
                variant.label,
                mean_interval(results.drifts(variant), least=0).text(),
                "1" if variant == GLOBAL else drift[-1].text(2),
                mean_interval(_refinement_ms(results, variant), least=0).text(1),
                "1" if variant == GLOBAL else faster[-1].text(1),
            )
        )
    good = [
        k
        for k, (d, f) in enumerate(zip(drift[:-1], faster[:-1], strict=True))
        if d.value <= NEARLY and f.value >= MUCH
    ]
    verdict = Verdict.HOLDS if good else Verdict.FAILS
    best = good[0] if good else len(WINDOWS) - 1
    return Findings(
        verdict,
        f"A window of {WINDOWS[best]} frames has {drift[best].text(2)} times the drift of "
        f"adjusting all frames at every frame, and its refinement is {faster[best].text(1)} times "
        f"as fast on drives of {LENGTH_M:g} m; the ratio of times grows with the drive.",
        TableOf(
            (
                "adjusted at every frame",
                "drift over 1 m, %",
                "drift, ratio to all frames",
                "refinement, ms a frame",
                "times as fast as all frames",
            ),
            tuple(rows),
        ),
        "Drift (left) and time of the structure refinement (right) over the size of the window; "
        "dots are drives, lines their means, dashed: all frames.",
        lambda figure: _draw(figure, results),
        {
            "window": {
                "window, frames": np.repeat([*WINDOWS, ALL], len(results.recordings)),
                "drift over 1 m, %": np.concatenate([results.drifts(v) for v in VARIANTS]),
                "refinement, ms": np.concatenate([_refinement_ms(results, v) for v in VARIANTS]),
            }
        },
    )


def _refinement_ms(results: Results, variant: Variant) -> np.ndarray:
    """Mean time (N,) of the structure refinement."""
    return np.array(
        [np.nanmean(x.frames.timings_ms["structure refinement"]) for x in results.of(variant)]
    )


def _draw(figure: "Figure", results: Results) -> None:
    left, right = figure.subplots(1, 2)
    for panel, measure, label, colour in (
        (left, lambda v: results.drifts(v), "drift over 1 m, %", RED),
        (right, lambda v: _refinement_ms(results, v), "refinement, ms a frame", BLUE),
    ):
        means = [np.nanmean(measure(v)) for v in LOCAL.values()]
        panel.plot(WINDOWS, means, color=colour, lw=1.5)
        for window, variant in LOCAL.items():
            values = measure(variant)
            panel.plot(np.full(len(values), window), values, "o", color=colour, ms=3, alpha=0.5)
        panel.axhline(np.nanmean(measure(GLOBAL)), color=colour, ls="--", lw=1.0)
        panel.set_xscale("log", base=2)
        panel.set_xticks(WINDOWS, [str(w) for w in WINDOWS])
        tidy(panel, "window, frames", label)
    right.set_yscale("log")
    right.yaxis.set_major_formatter("{x:g}")
    left.set_ylim(bottom=0)


EXPERIMENT = Experiment(
    id="E2",
    title="Local or global bundle adjustment",
    claim="Local bundle adjustment is nearly as accurate as global, and much faster.",
    source="section 4.2",
    setup="The thesis preset on office and brick_court, where every frame is a keyframe and "
    "structure is refined at every frame over the last few frames, or over all since the start. "
    f"Nearly: at most {NEARLY:g} times the drift; much: at least {MUCH:g} times as fast.",
    size_in=(9.0, 3.4),
    jobs=jobs,
    analyse=analyse,
)
