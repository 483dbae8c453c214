"""How fast this machine estimates and generates; `make bench`.

The estimators run on a single core, the generator on all of them. The generator stands beside a
plain loop over `mujoco.Renderer` that makes the same left image, right image and depth of the
same trip at the same quality. The two renderers take turns frame by frame, and the recording is
timed before and after them, so that all meet the same load of the machine.
"""

import importlib.metadata
import os
import platform
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from trials.cli import guard
from trials.commands import console
from trials.estimators import ESTIMATORS
from trials.speed import (
    EstimatorSpeed,
    GeneratorSpeed,
    RenderSpeed,
    Trial,
    measure_estimator,
    measure_generator,
    measure_renderers,
    on_cores,
)

DISTANCE_M, FRAMES = 5.0, 40
QUICK_DISTANCE_M, QUICK_FRAMES = 1.5, 8
"""Length of the drive, and how many of its frames both renderers draw."""

PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "gtsam", "numba")


def bench(
    scene: Annotated[str, typer.Option(help="Scene to drive through.")] = "brick_court",
    seed: Annotated[int, typer.Option(help="Of everything random.")] = 0,
    quick: Annotated[bool, typer.Option(help="A short drive: rough figures.")] = False,
) -> None:
    """Measure the speed of generator, renderers and estimators on this machine."""
    cores = sorted(os.sched_getaffinity(0))
    trial = Trial(scene, seed, QUICK_DISTANCE_M if quick else DISTANCE_M)
    frames = QUICK_FRAMES if quick else FRAMES
    with tempfile.TemporaryDirectory(prefix="driftyard-bench-") as name:
        folder = Path(name)
        dataset = folder / scene
        before = on_cores(cores, measure_generator, trial, dataset)
        rendered = on_cores(cores, measure_renderers, trial, frames, folder)
        after = on_cores(cores, measure_generator, trial, folder / "again")
        estimated = {x: on_cores(cores[:1], measure_estimator, x, dataset) for x in ESTIMATORS}
    versions = ", ".join(f"{x} {importlib.metadata.version(x)}" for x in PACKAGES)
    console.out.print(f"{scene}, seed {seed}, {trial.distance_m:g} m; {before.gl}")
    console.out.print(f"python {platform.python_version()}, {versions}")
    console.out.print(generator_table((before, after), rendered, len(cores)))
    console.out.print(
        f"{before.frames} frames in {before.whole_s:.1f} s with scene, drive and map; "
        f"left images of the two renderers differ in {100 * rendered.different:.2f} % of pixels"
    )
    console.out.print(estimator_table(estimated))


def generator_table(
    recorded: tuple[GeneratorSpeed, ...], rendered: RenderSpeed, cores: int
) -> Table:
    """Lay out rendering alone, then with the files, each beside the stock loop."""
    table = Table(f"generation, {cores} cores", "ms per frame", "frames/s", "ratio to stock")
    for column in table.columns[1:]:
        column.justify = "right"

    def row(label: str, ms: float, stock_ms: float, end_section: bool = False) -> None:
        figures = f"{ms:.1f}", f"{1e3 / ms:.1f}", f"{stock_ms / ms:.2f}"
        table.add_row(label, *figures, end_section=end_section)

    written_ms = rendered.stock_ms + rendered.stock_files_ms
    row("stock, rendered", rendered.stock_ms, rendered.stock_ms)
    row("ours, rendered", rendered.ours_ms, rendered.stock_ms, end_section=True)
    row("stock, rendered and written", written_ms, written_ms)
    row("ours, recorded", sum(x.frame_ms for x in recorded) / len(recorded), written_ms)
    return table


def estimator_table(estimated: dict[str, EstimatorSpeed]) -> Table:
    """Lay out milliseconds by stage, one column per estimator."""
    speeds = list(estimated.values())
    table = Table("estimation, 1 core, ms per frame", *estimated)
    for column in table.columns[1:]:
        column.justify = "right"
    for stage in dict.fromkeys(stage for x in speeds for stage in x.stage_ms):
        row = (f"{x.stage_ms[stage]:.1f}" if stage in x.stage_ms else "–" for x in speeds)
        table.add_row(stage, *row)
    table.add_section()
    table.add_row("all", *(f"{x.frame_ms:.1f}" for x in speeds))
    table.add_row("frames/s", *(f"{1e3 / x.frame_ms:.1f}" for x in speeds))
    return table


if __name__ == "__main__":
    guard(lambda: typer.run(bench))
