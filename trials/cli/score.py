"""`driftyard score`: errors of trajectories against the ground truth."""

import json
from collections.abc import Sequence
from pathlib import Path

import typer
from rich.table import Table

from trials.cli import console
from trials.cli.options import Dataset, Trajectories, option
from trials.evaluation.dataset_scores import score_runs
from trials.evaluation.mismatch import Frame
from trials.evaluation.runs import read_runs
from trials.evaluation.score import Score
from trials.evaluation.truth import true_trajectory
from trials.report.columns import check_columns
from trials.report.score_tables import segment_table as open_segment_table
from trials.report.tables import text_table
from vo.recordings.readers import read_body_pose, recording_name


def score(
    dataset: Dataset,
    files: Trajectories,
    as_json: bool = option(False, "Print all figures as JSON.", "--json"),
    frame: Frame = option(Frame.CAM, "Frame of the estimated poses: left camera, or body."),
    segment_table: Path | None = option(
        None, "Table of one row for each segment, .parquet or .csv.", metavar="FILE"
    ),
) -> None:
    """Compare trajectories with the ground truth of a dataset."""
    if segment_table is not None:
        check_columns(segment_table)
    runs = read_runs(dataset, files)
    scores = score_runs(dataset, runs, frame)
    if segment_table is not None:
        truth, T_body_cam = true_trajectory(dataset), read_body_pose(dataset)
        keys = {"dataset": str, "estimator": str, "file": str}
        with open_segment_table(segment_table, keys) as add:
            for run, x in zip(runs, scores, strict=True):
                values = {"dataset": str(dataset), "estimator": x.estimator, "file": str(run.path)}
                add(values, truth, run.moved(frame.T_frame_cam(T_body_cam)))
    if as_json:
        table = [{"file": str(file), **x.to_dict()} for file, x in zip(files, scores, strict=True)]
        typer.echo(json.dumps(table, indent=1, allow_nan=False))
        return
    with_attitude = all(x.has_attitude for x in scores)
    title = recording_name(dataset) + ("" if with_attitude else ": ATE without attitude")
    console.out.print(score_table(title, scores))


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Lay out one column per run."""
    labels = list(dict.fromkeys(label for x in scores for label, _ in x.rows))
    columns = [[dict(x.rows).get(label, "–") for label in labels] for x in scores]
    rows = zip(labels, *columns, strict=True)
    return text_table(("", *(x.estimator for x in scores)), rows, title)
