"""E12: bundle adjustment converges in 15 iterations from a good start (thesis 5.3)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from trials.execution.jobs import Job, Recording, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Scale, Steps, Table, Verdict
from trials.studies.experiments.measures import ragged, step_errors_m

SIMPLE, HARD = "office", "turntable"
MAX_ITERATIONS = 60
MANY = f"refinement.max_iterations={MAX_ITERATIONS}"
KEEPING = Variant("thesis", "thesis", (MANY,))
DROPPING = Variant("thesis, dropping", "thesis", (MANY, "refinement.max_keyframe_iterations=20"))
GOOD, DROP = 15, 20
"""Number of iterations from a good start, and that above which the thesis would drop a frame."""
STAGES = ("motion iterations", "structure iterations")


def _jobs(scale: Scale) -> Sequence[Job]:
    recordings = [
        Recording(s, seed, scale.drive) for s in (SIMPLE, HARD) for seed in scale.seeds[:3]
    ]
    return jobs_of(recordings, (KEEPING, DROPPING))


def iterations(runs: Sequence[Result], stage: str) -> np.ndarray:
    """Return the iterations of all frames but the first of each run; NaN if there were none."""
    return np.concatenate([x.frames.counts[stage][1:] for x in runs])


def _percent_below_good(results: Results, scene: str, stage: str) -> float:
    n = iterations(results.of(KEEPING, scene), stage)
    return 100 * float(np.mean(n[np.isfinite(n)] < GOOD))


def _conclude(results: Results) -> Finding:
    motion, structure = (_percent_below_good(results, SIMPLE, stage) for stage in STAGES)
    before, after = (float(np.nanmedian(results.drifts(v, HARD))) for v in (KEEPING, DROPPING))
    fast, helps = min(motion, structure) > 95, after < 0.9 * before
    verdict = Verdict.HOLDS if fast and helps else Verdict.PARTLY if fast else Verdict.FAILS
    return verdict, (
        f"From a good start ({SIMPLE}) {motion:.0f} % of the motion refinements and "
        f"{structure:.0f} % of the structure refinements need fewer than {GOOD} iterations. "
        f"Dropping frames that need more than {DROP} changes the median drift on {HARD} from "
        f"{before:.2f} to {after:.2f} %"
        + ("." if helps else ": the number of iterations does not indicate harmful frames.")
    )


def _table(results: Results) -> Table:
    rows: list[tuple[str, ...]] = []
    for scene in (SIMPLE, HARD):
        runs = results.of(KEEPING, scene)
        errors = np.concatenate([step_errors_m(x)[1:] for x in runs])
        for stage in STAGES:
            n = iterations(runs, stage)
            known = np.isfinite(n) & np.isfinite(errors)
            rank = stats.spearmanr(n[known], errors[known]).statistic if known.sum() > 9 else np.nan
            row = (
                scene,
                stage.split()[0],
                f"{np.nanmedian(n):.0f}",
                f"{np.nanquantile(n, 0.95):.0f}",
                f"{_percent_below_good(results, scene, stage):.1f}",
                f"{100 * float(np.mean(n[np.isfinite(n)] >= DROP)):.1f}",
                f"{rank:.2f}",
            )
            rows.append(row)
    return Table.of(
        f"scene | refinement of | iterations, median | 95th percentile | fewer than {GOOD}, % | "
        f"{DROP} and more, % | rank correlation with the step error",
        rows,
    )


def _data(results: Results) -> Data:
    return {
        scene: ragged(**{s: iterations(results.of(KEEPING, scene), s) for s in STAGES})
        for scene in (SIMPLE, HARD)
    }


def _draw(figure: Figure, results: Results) -> None:
    edges = np.arange(0, MAX_ITERATIONS + 2) - 0.5
    panels = figure.subplots(1, 2, sharey=True)
    for panel, stage in zip(panels, STAGES, strict=True):
        for scene, colour in ((SIMPLE, BLUE), (HARD, RED)):
            n = iterations(results.of(KEEPING, scene), stage)
            n = n[np.isfinite(n)]
            counts, _ = np.histogram(n, edges)
            panel.stairs(100 * counts / max(len(n), 1), edges, color=colour, label=scene, lw=1.2)
        for at in (GOOD, DROP):
            panel.axvline(at, color=INK, ls="--", lw=0.8)
        tidy(panel, "iterations", "refinements, %" if panel is panels[0] else "", stage)
    panels[1].legend(fontsize=8, frameon=False)


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
    steps=Steps(_jobs, _conclude, _table, _draw, _data),
)
