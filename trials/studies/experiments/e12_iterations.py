"""E12: bundle adjustment converges within 15 iterations from a good start (thesis 5.3)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from trials.execution.jobs import Job, Recording, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, INK, RED, tidy
from trials.studies.experiments.experiment import (
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.studies.experiments.measures import step_errors_m

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CALM, HARSH = "office", "turntable"
MOST = 60
PATIENT = Variant("thesis", "thesis", (f"refinement.max_iterations={MOST}",))
DROPPING = Variant(
    "thesis, dropping", "thesis",
    (f"refinement.max_iterations={MOST}", "refinement.max_keyframe_iterations=20"),
)  # fmt: skip
GOOD, DROP = 15, 20
"""Iterations that a good start needs at most, and after which the thesis would drop a frame."""
STAGES = ("motion iterations", "structure iterations")


def jobs(scale: Scale) -> Sequence[Job]:
    """Calm drives, and blurred turns that give bad starts."""
    recordings = [
        Recording(s, seed, scale.drive) for s in (CALM, HARSH) for seed in scale.seeds[:3]
    ]
    return jobs_of(recordings, (PATIENT, DROPPING))


def iterations(runs: Sequence[Result], stage: str) -> np.ndarray:
    """Iterations of all frames but the first of each run; NaN where the stage did not run."""
    return np.concatenate([x.frames.counts[stage][1:] for x in runs])


def analyse(results: Results) -> Findings:
    """Count iterations, and hold them against the error of the step."""
    rows: list[tuple[str, ...]] = []
    good: dict[tuple[str, str], float] = {}
    for scene in (CALM, HARSH):
        runs = results.of(PATIENT, scene)
        errors = np.concatenate([step_errors_m(x)[1:] for x in runs])
        for stage in STAGES:
            n = iterations(runs, stage)
            known = np.isfinite(n) & np.isfinite(errors)
            tells = (
                stats.spearmanr(n[known], errors[known]).statistic if known.sum() > 9 else np.nan
            )
            good[scene, stage] = 100 * float(np.mean(n[np.isfinite(n)] < GOOD))
            rows.append(
                (
                    scene,
                    stage.split()[0],
                    f"{np.nanmedian(n):.0f}",
                    f"{np.nanquantile(n, 0.95):.0f}",
                    f"{good[scene, stage]:.1f}",
                    f"{100 * float(np.mean(n[np.isfinite(n)] >= DROP)):.1f}",
                    f"{tells:.2f}",
                )
            )
    before, after = (float(np.nanmedian(results.drifts(v, HARSH))) for v in (PATIENT, DROPPING))
    fast = min(good[CALM, stage] for stage in STAGES) > 95
    helps = after < 0.9 * before
    verdict = Verdict.HOLDS if fast and helps else Verdict.PARTLY if fast else Verdict.FAILS
    return Findings(
        verdict,
        f"From a good start ({CALM}) {good[CALM, STAGES[0]]:.0f} % of the motion refinements and "
        f"{good[CALM, STAGES[1]]:.0f} % of the structure refinements need fewer than {GOOD} "
        f"iterations. Dropping frames that need more than {DROP} takes the median drift on {HARSH} "
        f"from {before:.2f} to {after:.2f} %"
        + ("." if helps else ": the count of iterations does not tell which frames hurt."),
        TableOf(
            (
                "scene",
                "refinement of",
                "iterations, median",
                "95th percentile",
                f"fewer than {GOOD}, %",
                f"{DROP} and more, %",
                "rank correlation with the step's error",
            ),
            tuple(rows),
        ),
        "Share of the refinements that need a number of iterations: of the motion (left) and of "
        f"motion and structure (right); dashed: {GOOD} and {DROP}.",
        lambda figure: _draw(figure, results),
        {
            scene: ragged(**{s: iterations(results.of(PATIENT, scene), s) for s in STAGES})
            for scene in (CALM, HARSH)
        },
    )


def _draw(figure: "Figure", results: Results) -> None:
    edges = np.arange(0, MOST + 2) - 0.5
    panels = figure.subplots(1, 2, sharey=True)
    for panel, stage in zip(panels, STAGES, strict=True):
        for scene, colour in ((CALM, BLUE), (HARSH, RED)):
            n = iterations(results.of(PATIENT, scene), stage)
            n = n[np.isfinite(n)]
            counts, _ = np.histogram(n, edges)
            panel.stairs(100 * counts / max(len(n), 1), edges, color=colour, label=scene, lw=1.2)
        for at in (GOOD, DROP):
            panel.axvline(at, color=INK, ls="--", lw=0.8)
        tidy(panel, "iterations", "refinements, %" if panel is panels[0] else "", stage)
    panels[1].legend(fontsize=8, frameon=False)


EXPERIMENT = Experiment(
    id="E12",
    title="Iterations of the refinement",
    claim="Bundle adjustment converges in under 15 iterations from a good start; a frame that "
    "needs 20 should be dropped.",
    source="section 5.3",
    setup=f"The thesis preset, allowed {MOST} iterations, in the calm office and on the blurred "
    "turns of turntable; and the same with frames dropped whose refinement needs more than "
    f"{DROP}.",
    size_in=(9.0, 3.2),
    jobs=jobs,
    analyse=analyse,
)
