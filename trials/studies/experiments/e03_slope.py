"""E3: without refinement, the pitch on a gentle slope is overestimated (thesis 4.3, fig. 4.2)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import mean_interval
from trials.execution.jobs import Job, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, INK, OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Scale, Steps, Table, Verdict
from trials.studies.experiments.measures import aligned_poses, mean_text, ragged
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED

LENGTH_M = 7.0
"""Length of the drive: up the slope and onto the plateau."""
SHOWN = {UNREFINED: BLUE, THESIS: RED, DEFAULT: OCHRE}


def _jobs(scale: Scale) -> Sequence[Job]:
    return jobs_of(scale.with_length(LENGTH_M).recordings(["ramp"]), SHOWN)


def _conclude(results: Results) -> Finding:
    signed = mean_interval(_end_errors_deg(results, UNREFINED))
    ratio = np.median(_rms_errors_deg(results, UNREFINED) / _rms_errors_deg(results, THESIS))
    larger, over = bool(ratio > 1), signed.low > 0
    verdict = Verdict.HOLDS if over and larger else Verdict.PARTLY if larger else Verdict.FAILS
    direction = "is underestimated" if signed.high < 0 else "has errors of either sign"
    direction = "is overestimated" if over else direction
    return verdict, (
        f"Without refinement the pitch {direction}: {signed.text(2)}° at the end of the climb; its "
        f"error is {ratio:.1f} times as large as with refinement (root mean square, median of "
        "pairs)."
    )


def _table(results: Results) -> Table:
    rows: list[tuple[str, ...]] = []
    for variant in SHOWN:
        height_mm = np.array([1e3 * _height_error_m(x)[-1] for x in results.of(variant)])
        row = (
            variant.label,
            mean_interval(_end_errors_deg(results, variant)).text(3),
            mean_text(_rms_errors_deg(results, variant)),
            mean_interval(height_mm).text(1),
            mean_text(results.drifts(variant)),
        )
        rows.append(row)
    return Table.of(
        "variant | pitch error at the end, ° | pitch error, rms, ° | height error at the end, mm | "
        "drift over 1 m, %",
        rows,
    )


def pitch_error_deg(run: Result) -> np.ndarray:
    """Return estimated minus true pitch (N,) at the poses, degrees, nose up positive."""
    truth, estimate = (
        np.degrees(np.arcsin(np.clip(T[:, 2, 2], -1, 1))) for T in aligned_poses(run)
    )
    return estimate - truth


def _end_errors_deg(results: Results, variant: Variant) -> np.ndarray:
    return np.array([pitch_error_deg(x)[-1] for x in results.of(variant)])


def _rms_errors_deg(results: Results, variant: Variant) -> np.ndarray:
    return np.array([np.sqrt(np.mean(pitch_error_deg(x) ** 2)) for x in results.of(variant)])


def _height_error_m(run: Result) -> np.ndarray:
    truth, estimate = aligned_poses(run)
    return estimate[:, 2, 3] - truth[:, 2, 3]


def _data(results: Results) -> Data:
    return {
        f"pitch {v.label}": ragged(
            **{f"seed {x.job.recording.seed}, °": pitch_error_deg(x) for x in results.of(v)}
        )
        for v in SHOWN
    }


def _draw(figure: Figure, results: Results) -> None:
    left, right = figure.subplots(1, 2)
    first = results.recordings[0]
    for variant, colour in SHOWN.items():
        run = results.at(first, variant)
        height_m = aligned_poses(run)[1][:, 2, 3]
        left.plot(run.pair.travelled_m, height_m, color=colour, lw=1.2, label=variant.label)
        for other in results.of(variant):
            right.plot(other.pair.travelled_m, pitch_error_deg(other), color=colour, lw=0.9)
    run = results.at(first, THESIS)
    left.plot(run.pair.travelled_m, run.pair.T_world_cam[:, 2, 3], label="truth", **TRUTH)
    left.legend(fontsize=8, frameon=False)
    right.axhline(0, color=INK, lw=0.8, ls="--")
    tidy(left, "true path, m", "height of the camera, m", f"ramp, seed {first.seed}")
    tidy(right, "true path, m", "pitch error, °", "all seeds")


E3 = Experiment(
    id="E3",
    title="A gentle slope without refinement",
    claim="Without refinement, the pitch of a camera that drives up a gentle slope is "
    "overestimated.",
    source="section 4.3, figure 4.2",
    setup="Drives up the 7 % slope of ramp: the thesis preset without refinement, the thesis "
    "preset, and the default settings.",
    caption="Left: height of the camera along the drive of the first seed. Right: error of its "
    "pitch on all drives, nose up positive.",
    size_in=(9.0, 3.4),
    steps=Steps(_jobs, _conclude, _table, _draw, _data),
)
