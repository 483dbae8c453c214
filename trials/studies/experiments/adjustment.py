"""E2 and E12: window and iterations of bundle adjustment (thesis 4.2 and 5.3)."""

from dataclasses import replace
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from trials.evaluation.intervals import Interval, ratio_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import draw_means, mean_text, step_errors_m
from vo.contract.arrays import Array, Mask

WINDOW_SCENES = ("office", "brick_court")
LENGTH_M = 2.4
"""Length of the drives: the time of global adjustment grows at least with the square of it."""
WINDOWS = (2, 4, 8, 16, 32)
ALL = 10_000
LOCAL = {
    window: Variant(f"last {window} frames", "thesis", (f"refinement.window={window}",))
    for window in WINDOWS
}
GLOBAL = Variant("all frames", "thesis", (f"refinement.window={ALL}",))
WINDOW_VARIANTS = (*LOCAL.values(), GLOBAL)
NEARLY = 1.2
"""Largest ratio of drifts that is nearly as accurate."""
MUCH = 3.0
"""Smallest ratio of times that is much faster."""


def _conclude_window(results: Results) -> Finding:
    ratios = {window: _ratios(results, variant) for window, variant in LOCAL.items()}
    good = [w for w, (x, y) in ratios.items() if x.value <= NEARLY and y.value >= MUCH]
    best = good[0] if good else max(ratios)
    drift, faster = ratios[best]
    return Verdict.HOLDS if good else Verdict.FAILS, (
        f"A window of {best} frames has {drift.text(2)} times the drift of adjusting all frames at "
        f"every frame, and its refinement is {faster.text(1)} times as fast on drives of "
        f"{LENGTH_M:g} m; the ratio of times grows with the drive."
    )


def _window_table(results: Results) -> Rows:
    for v in WINDOW_VARIANTS:
        drift, faster = _ratios(results, v)
        yield {
            "adjusted at every frame": v.label,
            "drift over 1 m, %": mean_text(results.drifts(v)),
            "drift, ratio to all frames": "1" if v == GLOBAL else drift.text(2),
            "refinement, ms per frame": mean_text(_refinement_ms(results, v), 1),
            "times as fast as all frames": "1" if v == GLOBAL else faster.text(1),
        }


def _window_data(results: Results) -> Data:
    return {
        "window": {
            "window, frames": np.repeat([*WINDOWS, ALL], len(results.recordings)),
            "drift over 1 m, %": np.concatenate([results.drifts(v) for v in WINDOW_VARIANTS]),
            "refinement, ms": np.concatenate([_refinement_ms(results, v) for v in WINDOW_VARIANTS]),
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


def _draw_window(figure: Figure, results: Results) -> None:
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
        WINDOW_SCENES
    ),
    variants=WINDOW_VARIANTS,
    steps=Steps(_conclude_window, _window_table, _draw_window, _window_data),
)


SIMPLE, HARD = SCENES = "office", "turntable"
MAX_ITERATIONS = 60
MANY = f"refinement.max_iterations={MAX_ITERATIONS}"
KEEPING = Variant("thesis", "thesis", (MANY,))
DROPPING = Variant("thesis, dropping", "thesis", (MANY, "refinement.max_keyframe_iterations=20"))
GOOD, DROP = 15, 20
"""Number of iterations from a good start, and that above which the thesis would drop a frame."""
STAGES = ("motion iterations", "structure iterations")


def _iterations(results: Results, scene: str, stage: str) -> Array:
    """Return the iterations of all frames but the first of each run; NaN if there were none."""
    return np.concatenate([x.frames.counts[stage][1:] for x in results.of(KEEPING, scene)])


def _percent(conditions: Mask) -> float:
    return 100 * float(np.mean(conditions))


def _conclude_iterations(results: Results) -> Finding:
    iterations = (_iterations(results, SIMPLE, stage) for stage in STAGES)
    motion, structure = (_percent(n[np.isfinite(n)] < GOOD) for n in iterations)
    before, after = (float(np.nanmedian(results.drifts(v, HARD))) for v in (KEEPING, DROPPING))
    fast, helps = min(motion, structure) > 95, after < 0.9 * before
    return Verdict.of(fast, helps), (
        f"From a good start ({SIMPLE}) {motion:.0f} % of the motion refinements and "
        f"{structure:.0f} % of the structure refinements need fewer than {GOOD} iterations. "
        f"Dropping frames that need more than {DROP} changes the median drift on {HARD} from "
        f"{before:.2f} to {after:.2f} %"
        + ("." if helps else ": the number of iterations does not indicate harmful frames.")
    )


def _iterations_table(results: Results) -> Rows:
    for scene, stage in product(SCENES, STAGES):
        n = _iterations(results, scene, stage)
        errors = np.concatenate([step_errors_m(x)[1:] for x in results.of(KEEPING, scene)])
        both = np.isfinite(n) & np.isfinite(errors)
        rank = stats.spearmanr(n[both], errors[both]).statistic if both.sum() > 9 else np.nan
        known = n[np.isfinite(n)]
        yield {
            "scene": scene,
            "refinement of": stage.split()[0],
            "iterations, median": f"{np.nanmedian(n):.0f}",
            "95th percentile": f"{np.nanquantile(n, 0.95):.0f}",
            f"fewer than {GOOD}, %": f"{_percent(known < GOOD):.1f}",
            f"{DROP} and more, %": f"{_percent(known >= DROP):.1f}",
            "rank correlation with the step error": f"{rank:.2f}",
        }


def _iterations_data(results: Results) -> Data:
    return {s: {stage: _iterations(results, s, stage) for stage in STAGES} for s in SCENES}


def _draw_iterations(figure: Figure, results: Results) -> None:
    edges = np.arange(0, MAX_ITERATIONS + 2) - 0.5
    panels = figure.subplots(1, 2, sharey=True)
    for panel, stage in zip(panels, STAGES, strict=True):
        for scene, colour in ((SIMPLE, BLUE), (HARD, RED)):
            n = _iterations(results, scene, stage)
            n = n[np.isfinite(n)]
            counts, _ = np.histogram(n, edges)
            panel.stairs(100 * counts / max(len(n), 1), edges, color=colour, label=scene, lw=1.2)
        for at in (GOOD, DROP):
            panel.axvline(at, color=INK, ls="--", lw=0.8)
        tidy(panel, "iterations", "refinements, %" if panel is panels[0] else "", stage)
    panels[1].legend()


E12 = Experiment(
    id="E12",
    title="Iterations of the refinement",
    claim="Bundle adjustment converges in under 15 iterations from a good start; a frame that "
    "needs 20 should be dropped.",
    source="section 5.3",
    setup=f"The thesis preset with at most {MAX_ITERATIONS} iterations, in the office and on the "
    "blurred turns of turntable; and the same without frames whose refinement needs more than "
    f"{DROP}.",
    caption="Fraction of the refinements that need a number of iterations: of the motion (left) "
    f"and of motion and structure (right); dashed: {GOOD} and {DROP}.",
    size_in=(9.0, 3.2),
    recordings=lambda scale: [
        scale.recording(scene, seed) for scene in SCENES for seed in scale.seeds[:3]
    ],
    variants=(KEEPING, DROPPING),
    steps=Steps(_conclude_iterations, _iterations_table, _draw_iterations, _iterations_data),
)
