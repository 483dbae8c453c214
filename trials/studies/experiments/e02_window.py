"""E2: local bundle adjustment is nearly as accurate as global, and much faster (thesis 4.2)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, ratio_interval
from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Scale, Steps, Table, Verdict
from trials.studies.experiments.measures import mean_text

SCENES = ("office", "brick_court")
LENGTH_M = 2.4
"""Length of the drives: the time of global adjustment grows at least with the square of it."""
WINDOWS = (2, 4, 8, 16, 32)
ALL = 10_000
LOCAL = {
    window: Variant(f"last {window} frames", "thesis", (f"refinement.window={window}",))
    for window in WINDOWS
}
GLOBAL = Variant("all frames", "thesis", (f"refinement.window={ALL}",))
VARIANTS = (*LOCAL.values(), GLOBAL)
NEARLY = 1.2
"""Largest ratio of drifts that is nearly as accurate."""
MUCH = 3.0
"""Smallest ratio of times that is much faster."""


def _jobs(scale: Scale) -> Sequence[Job]:
    short = replace(scale, distance_m=min(LENGTH_M, scale.distance_m))
    return jobs_of(short.recordings(SCENES), VARIANTS)


def _conclude(results: Results) -> Finding:
    drift, faster = _drift_ratios(results)[:-1], _time_ratios(results)[:-1]
    good = [
        k
        for k, (d, f) in enumerate(zip(drift, faster, strict=True))
        if d.value <= NEARLY and f.value >= MUCH
    ]
    best = good[0] if good else len(WINDOWS) - 1
    return Verdict.HOLDS if good else Verdict.FAILS, (
        f"A window of {WINDOWS[best]} frames has {drift[best].text(2)} times the drift of "
        f"adjusting all frames at every frame, and its refinement is {faster[best].text(1)} times "
        f"as fast on drives of {LENGTH_M:g} m; the ratio of times grows with the drive."
    )


def _table(results: Results) -> Table:
    ratios = zip(_drift_ratios(results), _time_ratios(results), strict=True)
    rows = [
        (
            variant.label,
            mean_text(results.drifts(variant)),
            "1" if variant == GLOBAL else drift.text(2),
            mean_text(_refinement_ms(results, variant), 1),
            "1" if variant == GLOBAL else faster.text(1),
        )
        for variant, (drift, faster) in zip(VARIANTS, ratios, strict=True)
    ]
    return Table.of(
        "adjusted at every frame | drift over 1 m, % | drift, ratio to all frames | refinement, ms "
        "per frame | times as fast as all frames",
        rows,
    )


def _data(results: Results) -> Data:
    return {
        "window": {
            "window, frames": np.repeat([*WINDOWS, ALL], len(results.recordings)),
            "drift over 1 m, %": np.concatenate([results.drifts(v) for v in VARIANTS]),
            "refinement, ms": np.concatenate([_refinement_ms(results, v) for v in VARIANTS]),
        }
    }


def _drift_ratios(results: Results) -> list[Interval]:
    return [ratio_interval(results.drifts(v), results.drifts(GLOBAL)) for v in VARIANTS]


def _time_ratios(results: Results) -> list[Interval]:
    reference_ms = _refinement_ms(results, GLOBAL)
    return [ratio_interval(reference_ms, _refinement_ms(results, v)) for v in VARIANTS]


def _refinement_ms(results: Results, variant: Variant) -> np.ndarray:
    """Return the mean time (N,) of the structure refinement of each run."""
    return np.array(
        [np.nanmean(x.frames.timings_ms["structure refinement"]) for x in results.of(variant)]
    )


def _draw(figure: Figure, results: Results) -> None:
    left, right = figure.subplots(1, 2)
    for panel, measure, label, colour in (
        (left, lambda v: results.drifts(v), "drift over 1 m, %", RED),
        (right, lambda v: _refinement_ms(results, v), "refinement, ms per frame", BLUE),
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


E2 = Experiment(
    id="E2",
    title="Local or global bundle adjustment",
    claim="Local bundle adjustment is nearly as accurate as global, and much faster.",
    source="section 4.2",
    setup="The thesis preset on office and brick_court, where every frame is a keyframe and "
    "structure is refined at every frame over the last few frames, or over all since the start. "
    f"Nearly: at most {NEARLY:g} times the drift; much: at least {MUCH:g} times as fast.",
    caption="Drift (left) and time of the structure refinement (right) over the size of the "
    "window; dots are drives, lines their means, dashed: all frames.",
    size_in=(9.0, 3.4),
    steps=Steps(_jobs, _conclude, _table, _draw, _data),
)
