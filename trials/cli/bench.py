"""`driftyard bench`: speed of generator, estimators, start and environments on this machine."""

import importlib.metadata
import platform
from pathlib import Path

from trials.cli import console
from trials.cli.options import Seed, option
from trials.studies.bench import bench_over, bench_parts
from trials.studies.speed.engine import measure_engine
from vo.recordings.readers import open_sequence

PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "gtsam", "numba")


def bench(
    scene: str = option("brick_court", "Scene of the part generation."),
    seed: Seed = 0,
    quick: bool = option(False, "Use short drives, for rough figures."),
    only: str = option(
        "",
        "Parts: generation, lengths, estimators, endurance, start, environments; all by default. "
        "And devices, costs, scheduler, engines, cameras.",
        metavar="A,B,C",
    ),
    over: Path | None = option(
        None, "Run only the estimators, over this dataset.", metavar="DATASET"
    ),
    engine: bool = option(
        False, "Measure only the executor of tasks, and the gain of a second worker.", "--engine"
    ),
) -> None:
    """Measure the speed of generator, estimators, start and environments on this machine.

    The estimators run in turn over five recordings, and the default one over a long sequence.
    With --over, times and memory at the end of the dataset are printed beside those at its start,
    and the time of a window of keyframes by each backend of bundle adjustment.
    """
    if engine:
        report = measure_engine(scene, console.progress_bar)
    elif over is not None:
        open_sequence(over)  # a wrong path is refused before a process is started
        report = bench_over(over, console.progress_bar)
    else:
        names = [name for name in only.split(",") if name]
        report = bench_parts(scene, seed, quick, names, console.progress_bar)
    versions = ", ".join(f"{x} {importlib.metadata.version(x)}" for x in PACKAGES)
    console.out.print(f"python {platform.python_version()}, {versions}")
    for part in report:
        console.out.print(part)
