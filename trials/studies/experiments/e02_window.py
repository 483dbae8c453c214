"""E2: local bundle adjustment is nearly as accurate as global, and much faster (thesis 4.2)."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, ratio_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import draw_means, mean_text
from vo.contract.arrays import Array

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


def _conclude(results: Results) -> Finding:
    ratios = {window: _ratios(results, variant) for window, variant in LOCAL.items()}
    good = [w for w, (x, y) in ratios.items() if x.value <= NEARLY and y.value >= MUCH]
    best = good[0] if good else max(ratios)
    drift, faster = ratios[best]
    return Verdict.HOLDS if good else Verdict.FAILS, (
        f"A window of {best} frames has {drift.text(2)} times the drift of adjusting all frames at "
        f"every frame, and its refinement is {faster.text(1)} times as fast on drives of "
        f"{LENGTH_M:g} m; the ratio of times grows with the drive."
    )


def _table(results: Results) -> Rows:
    for v in VARIANTS:
        drift, faster = _ratios(results, v)
        yield {
            "adjusted at every frame": v.label,
            "drift over 1 m, %": mean_text(results.drifts(v)),
            "drift, ratio to all frames": "1" if v == GLOBAL else drift.text(2),
            "refinement, ms per frame": mean_text(_refinement_ms(results, v), 1),
            "times as fast as all frames": "1" if v == GLOBAL else faster.text(1),
        }


def _data(results: Results) -> Data:
    return {
        "window": {
            "window, frames": np.repeat([*WINDOWS, ALL], len(results.recordings)),
            "drift over 1 m, %": np.concatenate([results.drifts(v) for v in VARIANTS]),
            "refinement, ms": np.concatenate([_refinement_ms(results, v) for v in VARIANTS]),
        }
    }


def _ratios(results: Results, variant: Variant) -> tuple[Interval, Interval]:
    """Return the drift over that of all frames, and the time of all frames over its own."""
    drift = ratio_interval(results.drifts(variant), results.drifts(GLOBAL))
    return drift, ratio_interval(_refinement_ms(results, GLOBAL), _refinement_ms(results, variant))


def _refinement_ms(results: Results, variant: Variant) -> Array:
    """Return the mean time (N,) of the structure refinement of each run."""
    ms = [x.frames.timings_ms["structure refinement"] for x in results.of(variant)]
    return np.array([np.nanmean(x) for x in ms])


def _draw(figure: Figure, results: Results) -> None:
    left, right = figure.subplots(1, 2)
    for panel, measure, label, colour in (
        (left, results.drifts, "drift over 1 m, %", RED),
        (right, lambda v: _refinement_ms(results, v), "refinement, ms per frame", BLUE),
    ):
        draw_means(panel, {window: measure(v) for window, v in LOCAL.items()}, colour)
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
    recordings=lambda scale: replace(scale, distance_m=min(LENGTH_M, scale.distance_m)).recordings(
        SCENES
    ),
    variants=VARIANTS,
    steps=Steps(_conclude, _table, _draw, _data),
)
