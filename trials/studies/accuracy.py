"""Drift of the default settings on drives that were not used for tuning; `driftyard accuracy`.

Every scene is driven with successive seeds, from 0 on by default; the decisions say on which seeds
parameters were chosen. A drive is one sample: results are medians over drives, with the worst drive
and a bootstrap interval over drives.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.table import Table
from scipy import stats

from trials.estimators.choice import COMPARED
from trials.evaluation.consistency import summarize
from trials.evaluation.score import Score
from trials.evaluation.wrong_steps import SIGMAS, WRONG_DEG, WRONG_M, WrongSteps
from trials.execution.jobs import Result, Variant
from trials.report.tables import text_table
from vo.contract.arrays import Array
from vo.contract.files import write_text

SCENES = "brick_court,office"
"""Scenes by default; all of them take hours."""
VARIANTS = tuple(Variant(name, name) for name in COMPARED)
RESAMPLES, CONFIDENCE = 10_000, 0.95


METRICS: dict[str, tuple[Callable[[Score], float | None], int]] = {
    "drift over 1 m, median, %": (lambda x: x.drift_1m.median_percent if x.drift_1m else None, 3),
    "drift over 1 m, mean, %": (lambda x: x.drift_1m.mean_percent if x.drift_1m else None, 3),
    "rotation over 1 m, °/m": (lambda x: x.drift_1m.mean_deg_per_m if x.drift_1m else None, 4),
    "end point, % of path": (lambda x: x.end_percent, 3),
    "ATE, SE(3), m": (lambda x: x.ate_m["se3"].rmse, 4),
    "ms per frame, median, all cores busy": (lambda x: x.frame_ms, 1),
}
"""Label with unit to the metric and its printed digits."""


def summary_tables(runs: Mapping[str, Sequence[Result]]) -> list[Table]:
    """Tabulate the drift of the first estimator beside that of each other, a table for each."""
    ours, *others = dict.fromkeys(x.job.variant.label for some in runs.values() for x in some)
    return [_comparison(ours, name, runs) for name in others]


def _of(runs: Sequence[Result], name: str) -> list[Result]:
    return [x for x in runs if x.job.variant.label == name]


def _comparison(ours: str, other: str, runs: Mapping[str, Sequence[Result]]) -> Table:
    """Tabulate medians over drives, with a row for each scene."""
    rows: list[tuple[str, ...]] = []
    for scene, of_scene in runs.items():
        both = _of(of_scene, ours), _of(of_scene, other)
        drift, their_drift = ([x.drift_percent for x in some] for some in both)
        median, their_median = np.median(drift), np.median(their_drift)
        turn = np.median([x.rotation_deg_per_m for x in both[0]])
        lost, their_lost = (str(sum(x.lost_frames for x in some)) for some in both)
        cells = [_number(x, 3) for x in (median, np.max(drift), turn)]
        theirs = [_number(their_median, 3), _number(median / their_median, 2)]
        rows.append((scene, *cells, lost, *theirs, their_lost))
    header = ("drift over 1 m, %", ours, "worst", "°/m", "lost", other, "ratio", "lost")
    return text_table(header, rows)


def _number(value: float, digits: int) -> str:
    return "–" if np.isnan(value) else f"{value:.{digits}f}"


def bootstrap_interval(values: Array) -> tuple[float, float]:
    """Return the percentile interval at CONFIDENCE of the median of (N,) values, N >= 2.

    With five values it is nearly their range; drives, not segments, are independent samples.

    Source:
        Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13.
    """
    low, high = stats.bootstrap(
        (values,), np.median, n_resamples=RESAMPLES, confidence_level=CONFIDENCE,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return float(low), float(high)


def accuracy_table(title: str, runs: Sequence[Result]) -> Table:
    """Tabulate every metric of every estimator: median over drives, worst, interval."""
    names = list(dict.fromkeys(x.job.variant.label for x in runs))
    drives = len(runs) // len(names)
    path_m = sum(x.path_m for x in runs) / len(names)
    rows: list[tuple[str, ...]] = []
    for name in names:
        mine = _of(runs, name)
        for label, (metric, digits) in METRICS.items():
            values = [metric(x.score) if x.score else None for x in mine]
            first = name if label == next(iter(METRICS)) else ""
            rows.append((first, label, *_statistics(values, digits)))
        lost = [x.lost_frames for x in mine]
        total = f"{sum(lost)} of {sum(len(x.frames) for x in mine)}"
        rows.append(("", "frames lost", total, str(max(lost)), ""))
    title = f"{title}: {drives} {'drive' if drives == 1 else 'drives'}, {path_m:.1f} m in all"
    return text_table(("estimator", "metric", "median", "worst", "95 %"), rows, title)


def _statistics(values: list[float | None], digits: int) -> tuple[str, str, str]:
    """Format median, worst and interval; dashes if a drive has no value."""
    known = np.array([x for x in values if x is not None])
    if len(known) < len(values):
        return "–", "–", "–"
    median, worst = f"{np.median(known):.{digits}f}", f"{known.max():.{digits}f}"
    if len(known) == 1:
        return median, worst, "–"
    low, high = bootstrap_interval(known)
    return median, worst, f"{low:.{digits}f}–{high:.{digits}f}"


def wrong_steps_table(runs: Mapping[str, Sequence[Result]]) -> Table:
    """Tabulate the wrong steps of each estimator: a row for each scene, and one for all."""
    names = list(dict.fromkeys(x.job.variant.label for some in runs.values() for x in some))
    parts = {**runs, "all": [x for of_scene in runs.values() for x in of_scene]}
    rows: list[tuple[str, ...]] = []
    for name in names:
        for scene, some in parts.items():
            n = sum((x.wrong_steps for x in _of(some, name)), WrongSteps())
            beyond = str(n.beyond) if n.sized else "–"
            first = name if scene == next(iter(parts)) else ""
            numbers = (str(x) for x in (n.steps, n.wrong, n.silent))
            rows.append((first, scene, *numbers, beyond, _percent(n.flagged, n.steps)))
    header = ("estimator", "scene", "steps", "wrong", "of them tracked",
              f"beyond {SIGMAS} sigma", "right but weak, %")  # fmt: skip
    return text_table(
        header, rows, f"steps wrong by more than {WRONG_M * 1e3:g} mm or {WRONG_DEG}°"
    )


def consistency_table(runs: Mapping[str, Sequence[Result]]) -> Table:
    """Tabulate the NEES of estimators that give covariances: a row for each scene and for all."""
    names = list(dict.fromkeys(x.job.variant.label for some in runs.values() for x in some))
    parts = {**runs, "all": [x for of_scene in runs.values() for x in of_scene]}
    rows: list[tuple[str, ...]] = []
    for name in names:
        for scene, some in parts.items():
            known = [x.nees for x in _of(some, name) if x.nees is not None]
            for x in summarize(known)[:1]:
                first = name if scene == next(iter(parts)) else ""
                rows.append(
                    (
                        first,
                        scene,
                        str(x.steps),
                        f"{x.step:.1f}",
                        _number(100 * x.step_inside, 0),
                        _number(x.over_1m, 1),
                        _number(100 * x.over_1m_inside, 0),
                    )
                )
    header = ("estimator", "scene", "steps", "NEES of steps", "% inside 95 %",
              "NEES over 1 m", "% inside 95 %")  # fmt: skip
    return text_table(header, rows, "consistency of covariances: the mean NEES should be 6")


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.2f}" if whole else "–"


def write_scores(out: Path, runs: Mapping[str, Sequence[Result]]) -> None:
    """Write the scores of all runs as JSON, by scene."""
    content = {
        name: [
            {"seed": x.job.recording.seed, "estimator": x.job.variant.label,
             "score": asdict(x.score) if x.score else None, "steps": asdict(x.wrong_steps)}
            for x in of_scene
        ]
        for name, of_scene in runs.items()
    }  # fmt: skip
    write_text(out, json.dumps(content, indent=1) + "\n")
