"""`driftyard view`: datasets and runs in Rerun's viewer."""

from pathlib import Path

import driftyard
from trials.cli import console
from trials.cli.options import Dataset, FrameOptions, ViewerOptions, argument


def view(
    dataset: Dataset,
    frames: FrameOptions,
    viewer: ViewerOptions,
    files: list[Path] = argument(
        [], "Trajectory files: TUM, EuRoC or KITTI format.", metavar="FILE"
    ),
) -> None:
    """Show a dataset and runs over it in Rerun's viewer: world, images, errors, status, sensors.

    It needs the package rerun-sdk, the extra `view` of driftyard.
    """
    to = viewer.to
    with console.progress_bar("viewing") as progress:
        driftyard.view(frames.open(dataset), files, to, progress=progress)
    if viewer.save:
        console.out.print(f"{viewer.save}: open it with `rerun {viewer.save}`", markup=False)
