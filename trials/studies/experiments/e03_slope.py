"""E3: without refinement, the pitch on a gentle slope is overestimated (thesis 4.3, fig. 4.2)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.execution.jobs import Job, Result, Results, jobs_of
from trials.report.figure import BLUE, INK, OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.experiment import (
    FULL,
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.studies.experiments.measures import aligned_poses, pitch_deg
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LENGTH_M = 7.0
"""Up the slope and onto the plateau."""
SHOWN = ((UNREFINED, BLUE), (THESIS, RED), (DEFAULT, OCHRE))


def jobs(scale: Scale) -> Sequence[Job]:
    """Drives up the ramp."""
    longer = replace(scale, distance_m=LENGTH_M * min(1.0, scale.distance_m / FULL.distance_m))
    return jobs_of(longer.recordings(["ramp"]), [v for v, _ in SHOWN])


def pitch_error_deg(run: Result) -> np.ndarray:
    """Estimated less true pitch (N,) at the poses, degrees, nose up positive."""
    truth, estimate = aligned_poses(run)
    return pitch_deg(estimate) - pitch_deg(truth)


def analyse(results: Results) -> Findings:
    """Compare pitch and height with and without refinement."""
    rows: list[tuple[str, ...]] = []
    ends: dict[str, np.ndarray] = {}
    sizes: dict[str, np.ndarray] = {}
    for variant, _ in SHOWN:
        runs = results.of(variant)
        ends[variant.label] = np.array([pitch_error_deg(x)[-1] for x in runs])
        sizes[variant.label] = np.array([np.sqrt(np.mean(pitch_error_deg(x) ** 2)) for x in runs])
        height_mm = np.array([1e3 * _height_error_m(x)[-1] for x in runs])
        rows.append(
            (
                variant.label,
                mean_interval(ends[variant.label]).text(3),
                mean_interval(sizes[variant.label], least=0).text(3),
                mean_interval(height_mm).text(1),
                mean_interval(results.drifts(variant), least=0).text(3),
            )
        )
    none, refined = UNREFINED.label, THESIS.label
    signed = mean_interval(ends[none])
    larger = bool(np.median(sizes[none] / sizes[refined]) > 1)
    over = signed.low > 0
    verdict = Verdict.HOLDS if over and larger else Verdict.PARTLY if larger else Verdict.FAILS
    direction = (
        "is overestimated"
        if over
        else "is underestimated"
        if signed.high < 0
        else "errs to either side"
    )
    return Findings(
        verdict,
        f"Without refinement the pitch {direction}: {signed.text(2)}° at the end of the climb; its "
        f"error is {np.median(sizes[none] / sizes[refined]):.1f} times as large as with it "
        "(root mean square, median of pairs).",
        TableOf(
            (
                "variant",
                "pitch error at the end, °",
                "pitch error, rms, °",
                "height error at the end, mm",
                "drift over 1 m, %",
            ),
            tuple(rows),
        ),
        "Left: height of the camera along the drive of the first seed. Right: error of its pitch "
        "on all drives, nose up positive.",
        lambda figure: _draw(figure, results),
        {
            f"pitch {v.label}": ragged(
                **{f"seed {x.job.recording.seed}, °": pitch_error_deg(x) for x in results.of(v)}
            )
            for v, _ in SHOWN
        },
    )


def _height_error_m(run: Result) -> np.ndarray:
    truth, estimate = aligned_poses(run)
    return estimate[:, 2, 3] - truth[:, 2, 3]


def _draw(figure: "Figure", results: Results) -> None:
    left, right = figure.subplots(1, 2)
    first = results.recordings[0]
    for variant, colour in SHOWN:
        run = results.at(first, variant)
        along_m = run.pair.travelled_m
        height_m = aligned_poses(run)[1][:, 2, 3]
        left.plot(along_m, height_m, color=colour, lw=1.2, label=variant.label)
        for other in results.of(variant):
            right.plot(other.pair.travelled_m, pitch_error_deg(other), color=colour, lw=0.9)
    run = results.at(first, THESIS)
    left.plot(run.pair.travelled_m, run.pair.T_world_cam[:, 2, 3], label="truth", **TRUTH)
    left.legend(fontsize=8, frameon=False)
    right.axhline(0, color=INK, lw=0.8, ls="--")
    tidy(left, "true path, m", "height of the camera, m", f"ramp, seed {first.seed}")
    tidy(right, "true path, m", "pitch error, °", "all seeds")


EXPERIMENT = Experiment(
    id="E3",
    title="A gentle slope without refinement",
    claim="Without refinement, the pitch of a camera that drives up a gentle slope is "
    "overestimated.",
    source="section 4.3, figure 4.2",
    setup="Drives up the 7 % slope of ramp: the thesis preset without any refinement, whole, and "
    "the default settings.",
    size_in=(9.0, 3.4),
    jobs=jobs,
    analyse=analyse,
)
