"""`driftyard run`: an estimator over a dataset."""

import statistics
from dataclasses import replace
from pathlib import Path
from typing import Literal

import driftyard
from trials.cli import console
from trials.cli.options import AnyEstimatorOptions, Dataset, FrameOptions, LiveViewOptions, option
from trials.estimators.choice import Named
from trials.estimators.plugins.command import Command
from vo.contract.estimator import Status


def run(
    dataset: Dataset,
    estimator: AnyEstimatorOptions,
    frames: FrameOptions,
    viewer: LiveViewOptions,
    out: Path = option(..., "Trajectory file to write, TUM format."),
    budget_ms: float | None = option(
        None, "Time for a frame; it then leaves out work, and says which.", min=0, metavar="MS"
    ),
    self_calibrate: Literal["auto", "off"] | None = option(
        None, "Whether significant errors of the stereo calibration are corrected; auto by default."
    ),
) -> None:
    """Run an estimator over a dataset; write its trajectory and a record of every frame.

    Until the run is complete, the frames so far are in FILE.unfinished.txt beside the trajectory.
    """
    given = {"budget_ms": budget_ms, "self_calibration": self_calibrate}
    overrides = [f"{key}={value}" for key, value in given.items() if value is not None]
    estimator = replace(estimator, overrides=[*estimator.overrides, *overrides])
    run_estimator(frames.open(dataset), estimator.choice, out, viewer.live)


def run_estimator(
    dataset: driftyard.Dataset, choice: Named | Command, out: Path, view: Path | str | bool = False
) -> None:
    """Run an estimator as `driftyard.run`, with a progress bar, and print a summary."""
    with console.progress_bar(f"running {choice.name}") as progress:
        made = driftyard.run(dataset, choice, out, progress=progress, view=view)
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
