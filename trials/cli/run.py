"""`driftyard run`: an estimator over a dataset."""

import statistics
from pathlib import Path

import driftyard
from trials.cli import console
from trials.cli.options import AnyEstimatorOptions, Dataset, FrameOptions, option
from trials.estimators.choice import Named
from trials.estimators.plugins.command import Command
from vo.contract.estimator import Status


def run(
    dataset: Dataset,
    estimator: AnyEstimatorOptions,
    frames: FrameOptions,
    out: Path = option(..., "Trajectory file to write, TUM format."),
) -> None:
    """Run an estimator over a dataset; write its trajectory and a record of every frame.

    Until the run is complete, the frames so far are in FILE.unfinished.txt beside the trajectory.
    """
    opened = driftyard.open(
        dataset,
        first=frames.first,
        last=frames.last,
        every=frames.every,
        skip_missing=frames.skip_missing,
        pair_tolerance_ms=frames.pair_tolerance,
    )
    run_estimator(opened, estimator.choice, out)


def run_estimator(dataset: driftyard.Dataset, choice: Named | Command, out: Path) -> None:
    """Run an estimator as `driftyard.run`, with a progress bar, and print a summary."""
    with console.progress_bar(f"running {choice.name}") as progress:
        made = driftyard.run(dataset, choice, out, progress=progress)
    frames = made.frames
    assert frames is not None  # our own runs always write it
    lost = [i for i, status in enumerate(frames.status) if status is Status.LOST]
    why = f"; the first lost: {frames.reason[lost[0]]}" if lost else ""
    unclaimed = len(dataset) - len(frames)
    counts = f"{len(lost)} lost" + (f", {unclaimed} between keyframes" if unclaimed else "")
    median_ms = statistics.median(frames.frame_ms)
    console.out.print(
        f"{out}: {len(dataset)} frames, {counts}, median {median_ms:.1f} ms per frame{why}",
        markup=False,
    )
