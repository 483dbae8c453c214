"""`driftyard run`: an estimator over a dataset."""

import statistics
from pathlib import Path

from trials.cli import console
from trials.cli.options import AnyEstimatorOptions, Dataset, FrameOptions, option
from trials.estimators.choice import Named, estimate
from trials.estimators.plugins.command import Command
from vo.contract.errors import SettingsError, TrajectoryError
from vo.contract.estimator import Status
from vo.recordings.pairing import ALL_FRAMES, FrameSelection
from vo.recordings.readers import open_sequence
from vo.recordings.synchronization import remark_unsynchronized


def run(
    dataset: Dataset,
    estimator: AnyEstimatorOptions,
    frames: FrameOptions,
    out: Path = option(..., "Trajectory file to write, TUM format."),
) -> None:
    """Run an estimator over a dataset; write its trajectory and a record of every frame.

    Until the run is complete, the frames so far are in FILE.unfinished.txt beside the trajectory.
    """
    selection = frames.selection
    if estimator.command is not None and (frames.first, frames.last, frames.every) != (0, None, 1):
        raise SettingsError("--command: a program reads all frames: no --first, --last or --every")
    run_estimator(dataset, out, estimator.choice, selection)


def run_estimator(
    dataset: Path, out: Path, choice: Named | Command, selection: FrameSelection = ALL_FRAMES
) -> None:
    """Run an estimator as `estimate`, with a progress bar, and print a summary.

    A remark is printed if the eyes do not show the same moments.
    """
    if out.is_dir():
        raise TrajectoryError(f"{out}: is a folder; --out names the trajectory file")
    sequence = open_sequence(dataset, selection)
    frames = len(sequence)
    remark_unsynchronized(sequence)
    with console.counting_bar(f"running {choice.name}", frames) as count:
        result = estimate(choice, dataset, out, count, selection)
    lost = [x for x in result.estimates if x.status is Status.LOST]
    median_ms = statistics.median(result.frame_ms)
    why = f"; the first lost: {lost[0].reason}" if lost else ""
    unclaimed = frames - len(result.estimates)
    counts = f"{len(lost)} lost" + (f", {unclaimed} between keyframes" if unclaimed else "")
    console.out.print(
        f"{out}: {frames} frames, {counts}, median {median_ms:.1f} ms per frame{why}", markup=False
    )
