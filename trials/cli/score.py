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
from trials.evaluation.runs import read_run
from trials.evaluation.score import Score, score_run
from trials.report.tables import text_table
from vo.contract.errors import DatasetError
from vo.contract.readers import open_sequence, read_truth


def score(
    dataset: Dataset,
    files: Trajectories,
    as_json: bool = option(False, "Print all figures as JSON.", "--json"),
) -> None:
    """Compare trajectories with the ground truth of a dataset."""
    scores = score_files(dataset, files)
    if as_json:
        table = [{"file": str(file), **asdict(x)} for file, x in zip(files, scores, strict=True)]
        typer.echo(json.dumps(table, indent=1, allow_nan=False))
        return
    console.out.print(score_table(dataset.resolve().name, scores))


def score_files(dataset: Path, files: Sequence[Path]) -> list[Score]:
    """Score trajectory files.

    Raises:
        DriftyardError: If dataset or a file is unreadable, or there is no ground truth.
    """
    truth = read_truth(dataset)
    if truth is None:
        raise DatasetError(f"{dataset}: holds no truth to compare with")
    frames = len(open_sequence(dataset))
    return [score_run(truth, read_run(file), frames) for file in files]


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Lay out one column per run."""
    rows = [(label, *(figure(x) for x in scores)) for label, figure in FIGURES.items()]
    return text_table(("", *(x.estimator for x in scores)), rows, title)


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _ate(score: Score, alignment: Alignment) -> str:
    errors = score.ate_m.get(alignment.value)
    return _number(errors.rmse if errors else None, 4)


FIGURES: dict[str, Callable[[Score], str]] = {
    "drift over 1 m, mean, %": lambda x: _number(x.drift_1m and x.drift_1m.mean_percent, 3),
    "drift over 1 m, median, %": lambda x: _number(x.drift_1m and x.drift_1m.median_percent, 3),
    "rotation over 1 m, °/m": lambda x: _number(x.drift_1m and x.drift_1m.mean_deg_per_m, 4),
    "end point, m": lambda x: _number(x.end_m, 3),
    "end point, % of path": lambda x: _number(x.end_percent, 2),
    "ATE, first pose, m": lambda x: _ate(x, Alignment.FIRST_POSE),
    "ATE, SE(3), m": lambda x: _ate(x, Alignment.SE3),
    "ATE, Sim(3), m": lambda x: _ate(x, Alignment.SIM3),
    "path, m": lambda x: _number(x.path_m, 2),
    "frames": lambda x: str(x.frames),
    "weak": lambda x: str(x.statuses.get("weak", "–")),
    "lost": lambda x: str(x.statuses.get("lost", "–")),
    "ms per frame, median": lambda x: _number(x.frame_ms, 1),
}
"""Rows of the table of errors."""
