"""`driftyard run`: an estimator over a dataset."""

import statistics
from pathlib import Path

from trials.cli import console
from trials.cli.options import AnyEstimatorOptions, Dataset, option
from trials.estimators.choice import Named, estimate
from trials.estimators.plugins.command import Command
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.readers import open_sequence


def run(
    dataset: Dataset,
    estimator: AnyEstimatorOptions,
    out: Path = option(..., "Trajectory file to write, TUM format."),
) -> None:
    """Run an estimator over a dataset; write its trajectory and a record of every frame."""
    run_estimator(dataset, out, estimator.choice)


def run_estimator(dataset: Path, out: Path, choice: Named | Command) -> None:
    """Run an estimator as `estimate`, with a progress bar, and print a summary."""
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
