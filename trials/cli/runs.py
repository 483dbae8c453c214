"""Estimating and judging: run, score, report."""

import json
import statistics
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.cli.datasets import Config, Overrides

if TYPE_CHECKING:
    from trials.estimators.choice import Named
    from trials.estimators.plugins.command import Command
    from trials.evaluation.score import Score

Dataset = Annotated[Path, typer.Argument(help="driftyard, EuRoC or KITTI odometry folder.")]
Files = Annotated[list[Path], typer.Argument(metavar="FILE...", help="Trajectories, TUM format.")]
Choice = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="driftyard, thesis, corner_flow or module:Class.",
        show_default="driftyard",
    ),
]
Program = Annotated[
    str | None,
    typer.Option(
        metavar="CMD",
        help="Or a program with {dataset} and {out} among its words; it writes a trajectory "
        "of the left camera, TUM format.",
    ),
]
Timeout = Annotated[
    float, typer.Option(metavar="SECONDS", min=0, help="Longest that the program may run.")
]
Label = Annotated[
    str, typer.Option(help="What tables call the program.", show_default="its file name")
]


def run(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Trajectory to write, TUM format.")],
    estimator: Choice = None,
    command: Program = None,
    timeout: Timeout = 3600.0,
    label: Label = "",
    overrides: Overrides = None,
    config: Config = None,
) -> None:
    """Run an estimator over a dataset; writes its trajectory and the record of every frame."""
    from vo.contract.errors import SettingsError

    if command is None:
        run_estimator(dataset, out, estimator or "driftyard", overrides or [], config)
        return
    if estimator or overrides or config:
        raise SettingsError("--command: takes no --estimator, --set or --config")
    from trials.estimators.plugins.command import Command

    run_choice(dataset, out, Command(command, timeout, label))


def score(
    dataset: Dataset,
    files: Files,
    as_json: Annotated[bool, typer.Option("--json", help="All figures, as JSON.")] = False,
) -> None:
    """Compare trajectories with a dataset's truth."""
    from trials.cli import console

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
    from trials.cli import console
    from trials.evaluation.runs import read_run
    from trials.report.page import write_report

    write_report(dataset, [read_run(file) for file in files], out)
    console.out.print(f"{out}")


def run_estimator(
    dataset: Path, out: Path, estimator: str, overrides: list[str], config: Path | None = None
) -> None:
    """Run one of ours or a class, with a progress bar, and say how it went.

    Raises:
        DriftyardError: If dataset, estimator or settings are wrong.
    """
    from trials.estimators.choice import Named

    run_choice(dataset, out, Named(estimator, config, tuple(overrides)))


def run_choice(dataset: Path, out: Path, choice: "Named | Command") -> None:
    """Run an estimator of any kind with a progress bar, write the files and say how it went.

    Raises:
        DriftyardError: If dataset, estimator or settings are wrong, or a plug-in fails.
    """
    from trials.cli import console
    from trials.estimators.choice import estimate
    from vo.contract.errors import TrajectoryError
    from vo.contract.estimator import Status
    from vo.contract.readers import open_sequence

    if out.is_dir():
        raise TrajectoryError(f"{out}: is a folder; --out names the trajectory file")
    frames = len(open_sequence(dataset))
    with console.counting_bar(f"running {choice.name}", frames) as count:
        result = estimate(choice, dataset, out, count)
    lost = [x for x in result.estimates if x.status is Status.LOST]
    median_ms = statistics.median(result.frame_ms)
    why = f"; the first lost: {lost[0].reason}" if lost else ""
    console.out.print(
        f"{out}: {frames} frames, {len(lost)} lost, median {median_ms:.1f} ms per frame{why}",
        markup=False,
    )


def score_files(dataset: Path, files: list[Path]) -> list["Score"]:
    """Score trajectory files.

    Raises:
        DriftyardError: If dataset or a file is unreadable, or there is no truth.
    """
    from trials.evaluation.runs import read_run
    from trials.evaluation.score import score_run
    from vo.contract.errors import DatasetError
    from vo.contract.readers import open_sequence, read_truth

    truth = read_truth(dataset)
    if truth is None:
        raise DatasetError(f"{dataset}: holds no truth to compare with")
    frames = len(open_sequence(dataset))
    return [score_run(truth, read_run(file), frames) for file in files]
