"""E4: without refinement, the drift on a handheld circle is large (thesis 4.3, fig. 4.3)."""

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import ratio_interval
from trials.execution.jobs import Result, Results
from trials.report.figure import BLUE, OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import lost_text, mean_text, paths_m
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED
from vo.contract.arrays import Array

LENGTH_M = 9.2
"""Length of one circle."""
SHOWN = {UNREFINED: BLUE, THESIS: RED, DEFAULT: OCHRE}
LARGE = 2.0
"""Smallest ratio of drifts that is large."""


def _conclude(results: Results) -> Finding:
    times = ratio_interval(results.drifts(UNREFINED), results.drifts(THESIS))
    return Verdict.of(times.value > 1, times.value >= LARGE and times.low > 1), (
        f"Without refinement the drift is {times.text(2)} times that with refinement, on a "
        f"handheld circle of {LENGTH_M:g} m."
    )


def _table(results: Results) -> Rows:
    for v in SHOWN:
        runs = results.of(v)
        end_m = np.array([x.score.end_m if x.score else np.nan for x in runs])
        yield {
            "variant": v.label,
            "drift over 1 m, %": mean_text(results.drifts(v)),
            "rotation, °/m": mean_text(np.array([x.rotation_deg_per_m for x in runs])),
            "end point, cm": mean_text(100 * end_m, 1),
            "frames lost, %": lost_text(results, v),
        }


def _error_m(run: Result) -> Array:
    truth, estimate = paths_m(run)
    return np.linalg.norm(estimate - truth, axis=1)


def _data(results: Results) -> Data:
    return {
        f"error {v.label}": {f"seed {x.job.recording.seed}, m": _error_m(x) for x in results.of(v)}
        for v in SHOWN
    }


def _draw(figure: Figure, results: Results) -> None:
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    first = results.recordings[0]
    truth = results.at(first, THESIS).truth.T_ref_frame[:, :2, 3]
    left.plot(*truth.T, label="truth", **TRUTH)
    for variant, colour in SHOWN.items():
        path = paths_m(results.at(first, variant))[1][:, :2]
        left.plot(*path.T, color=colour, lw=1.1, label=variant.label)
        for run in results.of(variant):
            right.plot(run.pair.travelled_m, 100 * _error_m(run), color=colour, lw=0.9)
    left.set_aspect("equal", adjustable="datalim")
    left.legend(loc="center")
    tidy(left, "x, m", "y, m", f"lab_circle, seed {first.seed}")
    tidy(right, "true path, m", "position error, cm", "all seeds")


E4 = Experiment(
    id="E4",
    title="A handheld circle",
    claim="Without refinement, the drift on a circle with a handheld camera is large.",
    source="section 4.3, figure 4.3",
    setup="One circle around the laboratory with a handheld camera at walking height: the thesis "
    "preset without refinement, the thesis preset, and the default settings. Large: at least "
    f"{LARGE:g} times the drift.",
    caption="Paths from above of the first seed, first poses aligned, and position error along "
    "the path on all drives.",
    size_in=(9.0, 3.8),
    recordings=lambda scale: scale.with_length(LENGTH_M).recordings(["lab_circle"]),
    variants=SHOWN,
    steps=Steps(_conclude, _table, _draw, _data),
)
