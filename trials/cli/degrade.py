"""`driftyard degrade`: disturbances on a real recording."""

from pathlib import Path

import driftyard
from trials.cli import console
from trials.cli.options import Dataset, Disturb, FrameOptions, Seed, option


def degrade(
    real: Dataset,
    frames: FrameOptions,
    disturb: Disturb = "",
    out: Path = option(..., "Folder to write, which `driftyard run` reads."),
    seed: Seed = 0,
) -> None:
    """Apply disturbances of lens, sensor, shutter and calibration to a real recording."""
    with console.progress_bar("disturbing") as progress:
        made = driftyard.degrade(frames.open(real), disturb, out, seed=seed, progress=progress)
    console.out.print(f"{out}: {len(made)} frames", markup=False)
