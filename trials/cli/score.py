"""`driftyard score`: errors of trajectories against the ground truth."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import typer
from rich.table import Table

from trials.cli import console
from trials.cli.options import Dataset, Trajectories, option
from trials.evaluation.alignment import Alignment
from trials.evaluation.mismatch import Frame, remark_mismatches
from trials.evaluation.runs import read_runs
from trials.evaluation.score import Score, score_run
from trials.evaluation.truth import true_trajectory
from trials.report.tables import text_table
from vo.recordings.readers import read_body_pose, read_frame_times


def score(
    dataset: Dataset,
    files: Trajectories,
    as_json: bool = option(False, "Print all figures as JSON.", "--json"),
    frame: Frame = option(Frame.CAM, "Frame of the estimated poses: left camera, or body."),
) -> None:
    """Compare trajectories with the ground truth of a dataset."""
    scores = score_files(dataset, files, frame)
    if as_json:
        table = [{"file": str(file), **asdict(x)} for file, x in zip(files, scores, strict=True)]
        typer.echo(json.dumps(table, indent=1, allow_nan=False))
        return
    with_attitude = all(x.has_attitude for x in scores)
    title = dataset.resolve().name + ("" if with_attitude else ": ATE without attitude")
    console.out.print(score_table(title, scores))


def score_files(dataset: Path, files: Sequence[Path], frame: Frame = Frame.CAM) -> list[Score]:
    """Score trajectory files; DriftyardError if a file or the ground truth cannot be read."""
    truth, T_body_cam = true_trajectory(dataset), read_body_pose(dataset)
    frames = len(read_frame_times(dataset))
    runs = [x.moved(frame.T_frame_cam(T_body_cam)) for x in read_runs(dataset, files)]
    for run in runs:
        remark_mismatches(truth, run, T_body_cam, frame)
    return [score_run(truth, run, frames) for run in runs]


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Lay out one column per run."""
    rows: list[tuple[str, ...]] = []
    for label, (figure, digits) in FIGURES.items():
        values = [figure(x) for x in scores]
        rows.append((label, *("–" if x is None else f"{x:.{digits}f}" for x in values)))
    return text_table(("", *(x.estimator for x in scores)), rows, title)


def _ate_m(score: Score, alignment: Alignment) -> float | None:
    errors = score.ate_m.get(alignment.value)
    return errors.rmse if errors else None


FIGURES: dict[str, tuple[Callable[[Score], float | None], int]] = {
    "drift over 1 m, mean, %": (lambda x: x.drift_1m.mean_percent if x.drift_1m else None, 3),
    "drift over 1 m, median, %": (lambda x: x.drift_1m.median_percent if x.drift_1m else None, 3),
    "rotation over 1 m, °/m": (lambda x: x.drift_1m.mean_deg_per_m if x.drift_1m else None, 4),
    "end point, m": (lambda x: x.end_m, 3),
    "end point, % of path": (lambda x: x.end_percent, 2),
    "ATE, first pose, m": (lambda x: _ate_m(x, Alignment.FIRST_POSE), 4),
    "ATE, SE(3), m": (lambda x: _ate_m(x, Alignment.SE3), 4),
    "ATE, Sim(3), m": (lambda x: _ate_m(x, Alignment.SIM3), 4),
    "path, m": (lambda x: x.path_m, 2),
    "frames": (lambda x: x.frames, 0),
    "frames compared": (lambda x: x.compared, 0),
    "weak": (lambda x: x.statuses.get("weak"), 0),
    "lost": (lambda x: x.statuses.get("lost"), 0),
    "ms per frame, median": (lambda x: x.frame_ms, 1),
}
"""Rows of the table of errors, each a figure and its digits."""
