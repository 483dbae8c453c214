"""E4: without refinement, a circle that is carried by hand drifts badly (thesis 4.3, fig. 4.3)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import mean_interval, ratio_interval
from trials.execution.jobs import Job, Results, jobs_of
from trials.report.figure import BLUE, OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.experiment import (
    FULL,
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.studies.experiments.measures import paths_m
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LENGTH_M = 9.2
"""Once around."""
SHOWN = ((UNREFINED, BLUE), (THESIS, RED), (DEFAULT, OCHRE))
BADLY = 2.0
"""Times the drift with refinement."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Circles in the laboratory."""
    once = replace(scale, distance_m=LENGTH_M * min(1.0, scale.distance_m / FULL.distance_m))
    return jobs_of(once.recordings(["lab_circle"]), [v for v, _ in SHOWN])


def analyse(results: Results) -> Findings:
    """Compare end point and drift with and without refinement."""
    rows: list[tuple[str, ...]] = []
    for variant, _ in SHOWN:
        scores = [x.score for x in results.of(variant)]
        end_m = np.array([s.end_m if s else np.nan for s in scores])
        turn = np.array([s.drift_1m.mean_deg_per_m if s and s.drift_1m else np.nan for s in scores])
        rows.append(
            (
                variant.label,
                mean_interval(results.drifts(variant), least=0).text(3),
                mean_interval(turn, least=0).text(3),
                mean_interval(100 * end_m, least=0).text(1),
                f"{100 * np.mean([x.lost_share for x in results.of(variant)]):.1f}",
            )
        )
    times = ratio_interval(results.drifts(UNREFINED), results.drifts(THESIS))
    verdict = Verdict.FAILS
    if times.value > 1:
        verdict = Verdict.HOLDS if times.value >= BADLY and times.low > 1 else Verdict.PARTLY
    return Findings(
        verdict,
        f"Without refinement the drift is {times.text(2)} times that with it, on a circle of "
        f"{LENGTH_M:g} m carried by hand.",
        TableOf(
            (
                "variant",
                "drift over 1 m, %",
                "rotation, °/m",
                "end point, cm",
                "frames lost, %",
            ),
            tuple(rows),
        ),
        "Paths from above of the first seed, first poses aligned, and how far each is from the "
        "truth along the way on all drives.",
        lambda figure: _draw(figure, results),
        {
            f"error {v.label}": ragged(
                **{f"seed {x.job.recording.seed}, m": _error_m(paths_m(x))
                   for x in results.of(v)}
            )
            for v, _ in SHOWN
        },
    )  # fmt: skip


def _error_m(paths: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    return np.linalg.norm(paths[1] - paths[0], axis=1)


def _draw(figure: "Figure", results: Results) -> None:
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    first = results.recordings[0]
    truth = results.at(first, THESIS).truth.T_ref_frame[:, :2, 3]
    left.plot(*truth.T, label="truth", **TRUTH)
    for variant, colour in SHOWN:
        path = paths_m(results.at(first, variant))[1][:, :2]
        left.plot(*path.T, color=colour, lw=1.1, label=variant.label)
        for run in results.of(variant):
            error_cm = 100 * _error_m(paths_m(run))
            right.plot(run.pair.travelled_m, error_cm, color=colour, lw=0.9)
    left.set_aspect("equal", adjustable="datalim")
    left.legend(fontsize=8, frameon=False, loc="center")
    tidy(left, "x, m", "y, m", f"lab_circle, seed {first.seed}")
    tidy(right, "true path, m", "position error, cm", "all seeds")


EXPERIMENT = Experiment(
    id="E4",
    title="A circle carried by hand",
    claim="Without refinement, a circle that is carried by hand drifts badly.",
    source="section 4.3, figure 4.3",
    setup="One turn around the laboratory, carried by hand at walking height: the thesis preset "
    f"without any refinement, whole, and the default settings. Badly: at least {BADLY:g} times "
    "the drift.",
    size_in=(9.0, 3.8),
    jobs=jobs,
    analyse=analyse,
)
