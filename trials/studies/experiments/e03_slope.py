"""E3: without refinement, the pitch on a gentle slope is overestimated (thesis 4.3, fig. 4.2)."""

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import mean_interval
from trials.execution.jobs import Result, Results, Variant
from trials.report.figure import BLUE, INK, OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import aligned_poses, mean_text
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED
from vo.contract.arrays import Array

LENGTH_M = 7.0
"""Length of the drive: up the slope and onto the plateau."""
SHOWN = {UNREFINED: BLUE, THESIS: RED, DEFAULT: OCHRE}


def _conclude(results: Results) -> Finding:
    signed = mean_interval(_end_errors_deg(results, UNREFINED))
    ratio = np.median(_rms_errors_deg(results, UNREFINED) / _rms_errors_deg(results, THESIS))
    direction = "has errors of either sign"
    if signed.low > 0 or signed.high < 0:
        direction = "is overestimated" if signed.low > 0 else "is underestimated"
    return Verdict.of(bool(ratio > 1), signed.low > 0), (
        f"Without refinement the pitch {direction}: {signed.text(2)}° at the end of the climb; its "
        f"error is {ratio:.1f} times as large as with refinement (root mean square, median of "
        "pairs)."
    )


def _table(results: Results) -> Rows:
    for v in SHOWN:
        yield {
            "variant": v.label,
            "pitch error at the end, °": mean_interval(_end_errors_deg(results, v)).text(3),
            "pitch error, rms, °": mean_text(_rms_errors_deg(results, v)),
            "height error at the end, mm": mean_interval(_height_errors_mm(results, v)).text(1),
            "drift over 1 m, %": mean_text(results.drifts(v)),
        }


def _pitch_error_deg(run: Result) -> Array:
    """Return estimated minus true pitch (N,) at the poses, degrees, nose up positive."""
    truth, estimate = (
        np.degrees(np.arcsin(np.clip(T[:, 2, 2], -1, 1))) for T in aligned_poses(run)
    )
    return estimate - truth


def _end_errors_deg(results: Results, variant: Variant) -> Array:
    return np.array([_pitch_error_deg(x)[-1] for x in results.of(variant)])


def _rms_errors_deg(results: Results, variant: Variant) -> Array:
    return np.array([np.sqrt(np.mean(_pitch_error_deg(x) ** 2)) for x in results.of(variant)])


def _height_errors_mm(results: Results, variant: Variant) -> Array:
    ends = (aligned_poses(x) for x in results.of(variant))
    return np.array([1e3 * (estimate[-1, 2, 3] - truth[-1, 2, 3]) for truth, estimate in ends])


def _data(results: Results) -> Data:
    return {
        f"pitch {v.label}": {
            f"seed {x.job.recording.seed}, °": _pitch_error_deg(x) for x in results.of(v)
        }
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
            right.plot(other.pair.travelled_m, _pitch_error_deg(other), color=colour, lw=0.9)
    run = results.at(first, THESIS)
    left.plot(run.pair.travelled_m, run.pair.T_world_cam[:, 2, 3], label="truth", **TRUTH)
    left.legend()
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
    recordings=lambda scale: scale.with_length(LENGTH_M).recordings(["ramp"]),
    variants=SHOWN,
    steps=Steps(_conclude, _table, _draw, _data),
)
