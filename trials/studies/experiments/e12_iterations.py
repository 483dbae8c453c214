"""E12: bundle adjustment converges in 15 iterations from a good start (thesis 5.3)."""

from itertools import product

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from trials.execution.jobs import Recording, Results, Variant
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import step_errors_m
from vo.contract.arrays import Array, Mask

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


def _conclude(results: Results) -> Finding:
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


def _table(results: Results) -> Rows:
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


def _data(results: Results) -> Data:
    return {s: {stage: _iterations(results, s, stage) for stage in STAGES} for s in SCENES}


def _draw(figure: Figure, results: Results) -> None:
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
        Recording(scene, seed, scale.drive) for scene in SCENES for seed in scale.seeds[:3]
    ],
    variants=(KEEPING, DROPPING),
    steps=Steps(_conclude, _table, _draw, _data),
)
