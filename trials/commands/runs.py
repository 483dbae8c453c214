"""Estimating and judging: run, score, report."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.commands.datasets import Config, Overrides

if TYPE_CHECKING:
    from trials.score import Score

Dataset = Annotated[Path, typer.Argument(help="driftyard, EuRoC or KITTI odometry folder.")]
Files = Annotated[list[Path], typer.Argument(metavar="FILE...", help="Trajectories, TUM format.")]


def run(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Trajectory to write, TUM format.")],
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="driftyard, corner_flow or module:Class.")
    ] = "driftyard",
    overrides: Overrides = None,
    config: Config = None,
) -> None:
    """Run an estimator over a dataset; writes its trajectory and the record of every frame."""
    run_estimator(dataset, out, estimator, overrides or [], config)


def score(
    dataset: Dataset,
    files: Files,
    as_json: Annotated[bool, typer.Option("--json", help="All figures, as JSON.")] = False,
) -> None:
    """Compare trajectories with a dataset's truth."""
    from trials.commands import console

    scores = score_files(dataset, files)
    if as_json:
        table = [{"file": str(file), **x.as_json()} for file, x in zip(files, scores, strict=True)]
        typer.echo(json.dumps(table, indent=1, allow_nan=False))
        return
    console.out.print(console.score_table(dataset.resolve().name, scores))


def report(
    dataset: Dataset,
    files: Files,
    out: Annotated[Path, typer.Option(help="Page to write.")] = Path("report.html"),
) -> None:
    """Show runs as one self-contained HTML page; the first file is shown in detail."""
    from trials.commands import console
    from trials.report.page import write_report
    from trials.runs import read_run

    write_report(dataset, [read_run(file) for file in files], out)
    console.out.print(f"{out}")


def run_estimator(
    dataset: Path, out: Path, estimator: str, overrides: list[str], config: Path | None = None
) -> None:
    """Run with a progress bar, write the files and say how it went.

    Raises:
        DriftyardError: If dataset, estimator or settings are wrong.
    """
    from trials.commands import console
    from trials.estimators import make_estimator
    from vo.contract.errors import TrajectoryError
    from vo.contract.estimator import Status
    from vo.contract.readers import open_sequence
    from vo.runner import run, write_run

    if out.is_dir():
        raise TrajectoryError(f"{out}: is a folder; --out names the trajectory file")
    sequence = open_sequence(dataset)
    tracker, settings = make_estimator(estimator, sequence.rig, config, overrides)
    with console.counting_bar(f"running {estimator}", len(sequence)) as count:
        result = run(sequence, tracker, count)
    write_run(out, result, estimator, settings, dataset)
    lost = sum(x.status is Status.LOST for x in result.estimates)
    mean_ms = sum(result.frame_ms) / len(result.frame_ms)
    console.out.print(f"{out}: {len(sequence)} frames, {lost} lost, {mean_ms:.1f} ms per frame")


def score_files(dataset: Path, files: list[Path]) -> list["Score"]:
    """Score trajectory files.

    Raises:
        DriftyardError: If dataset or a file is unreadable, or there is no truth.
    """
    from trials.runs import read_run
    from trials.score import score_run
    from vo.contract.errors import DatasetError
    from vo.contract.readers import open_sequence, read_truth

    truth = read_truth(dataset)
    if truth is None:
        raise DatasetError(f"{dataset}: holds no truth to compare with")
    frames = len(open_sequence(dataset))
    return [score_run(truth, read_run(file), frames) for file in files]
