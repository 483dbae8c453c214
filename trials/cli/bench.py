"""`driftyard bench`: speed of generator, renderers and estimators on this machine."""

import importlib.metadata
import platform
from pathlib import Path

from trials.cli import console
from trials.cli.options import Seed, option
from trials.studies import bench as study
from trials.studies.speed import backends
from vo.contract.readers import open_sequence

PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "gtsam", "numba")


def bench(
    scene: str = option("brick_court", "Scene to drive through."),
    seed: Seed = 0,
    quick: bool = option(False, "Use short drives, for rough figures."),
    over: Path | None = option(
        None, "Run only the estimators, over this dataset.", metavar="DATASET"
    ),
) -> None:
    """Measure the speed of generator, renderers and estimators on this machine.

    With --over, times and memory at the end of the dataset are printed beside those at its start,
    and the time of a window of keyframes by each backend of bundle adjustment.
    """
    if over is not None:
        open_sequence(over)  # a wrong path is refused before a process is started
        estimated = study.measure_estimators(over, console.progress_bar)
        _print_conditions(over.resolve().name)
        console.out.print(study.estimator_table(estimated))
        console.out.print(study.endurance_table(estimated))
        console.out.print(backends.backend_table(backends.measure_windows(over)))
        return
    found = study.measure_all(scene, seed, quick, console.progress_bar)
    generated = found.generated
    _print_conditions(f"{scene}, seed {seed}, {found.distance_m:g} m; {generated[0].gl}")
    console.out.print(study.generator_table(found))
    console.out.print(study.ratio_table(found))
    console.out.print(
        f"{generated[0].frames} frames in {generated[0].whole_s:.1f} s with scene, drive and map; "
        f"left images of both renderers differ by {found.rendered.different_grey:.2f} grey levels"
    )
    console.out.print(study.length_table(found.lengths))
    console.out.print(study.estimator_table(found.estimated))


def _print_conditions(what: str) -> None:
    versions = ", ".join(f"{x} {importlib.metadata.version(x)}" for x in PACKAGES)
    console.out.print(what)
    console.out.print(f"python {platform.python_version()}, {versions}")
