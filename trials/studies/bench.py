"""How fast this machine estimates and generates; `driftyard bench`.

The estimators run on a single core, the generator on all of them. The generator stands beside a
plain loop over `mujoco.Renderer` that makes the same left image, right image and depth of the
same trip at the same quality. The two renderers take turns of a few frames, and the recording is
timed before and after them, so that all meet the same load of the machine. At last a frame of a
drive of 300 m stands beside one of 30 m. `--over DATASET` asks for the estimators alone, over a
recording there is: what a frame costs at its end beside what one costs at its start.
"""

import os
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from trials.estimators.choice import COMPARED
from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.estimator import EstimatorSpeed, measure_estimator
from trials.studies.speed.generator import GeneratorSpeed, measure_generator, measure_scaling
from trials.studies.speed.length import LengthCost, measure_lengths
from trials.studies.speed.renderers import RenderSpeed, measure_renderers
from trials.studies.speed.trial import Trial, on_cores

DISTANCE_M, FRAMES = 5.0, 40
QUICK_DISTANCE_M, QUICK_FRAMES = 1.5, 8
"""Length of the drive, and how many of its frames both renderers draw."""
LONG_SCENE, LENGTHS_M, QUICK_LENGTHS_M = "long_haul", (30.0, 300.0), (3.0, 30.0)
"""Where a frame of a long drive is compared with one of a short drive."""


@dataclass(frozen=True)
class Speeds:
    """Speed of generator, renderers and estimators.

    Attributes:
        distance_m: Length of the drive.
        cores: Number that the generator uses.
        generated: The generator, before and after the renderers.
        rendered: Both renderers.
        scaling: Frame rate of two generators on a core each over that of one.
        lengths: A frame of a short and of a long drive.
        estimated: Estimators by name.
    """

    distance_m: float
    cores: int
    generated: tuple[GeneratorSpeed, GeneratorSpeed]
    rendered: RenderSpeed
    scaling: float
    lengths: LengthCost
    estimated: dict[str, EstimatorSpeed]


def measure_all(scene: str, seed: int, quick: bool, bar: ProgressBar = no_progress) -> Speeds:
    """Measure generator, renderers and estimators on a drive through a scene.

    Args:
        scene: Scene to drive through.
        seed: Random seed of the drive.
        quick: Whether to measure short drives.
        bar: Shows progress; a function that is importable by its name.
    """
    cores = sorted(os.sched_getaffinity(0))
    trial = Trial(scene, seed, QUICK_DISTANCE_M if quick else DISTANCE_M)
    frames = QUICK_FRAMES if quick else FRAMES
    with tempfile.TemporaryDirectory(prefix="driftyard-bench-") as name:
        folder = Path(name)
        dataset = folder / scene
        before = on_cores(cores, measure_generator, trial, dataset, bar)
        rendered = on_cores(cores, measure_renderers, trial, frames, folder, bar)
        after = on_cores(cores, measure_generator, trial, folder / "again", bar)
        scaling = measure_scaling(trial, cores[:2], folder)
        short, long = (
            Trial(LONG_SCENE, seed, x) for x in (QUICK_LENGTHS_M if quick else LENGTHS_M)
        )
        lengths = on_cores(cores, measure_lengths, short, long, frames, bar)
        estimated = measure_estimators(dataset, bar)
    generated = (before, after)
    return Speeds(trial.distance_m, len(cores), generated, rendered, scaling, lengths, estimated)


def measure_estimators(dataset: Path, bar: ProgressBar = no_progress) -> dict[str, EstimatorSpeed]:
    """Measure each estimator of COMPARED over a dataset, on a single core."""
    core = min(os.sched_getaffinity(0))
    return {x: on_cores([core], measure_estimator, x, dataset, bar) for x in COMPARED}


def generator_table(
    recorded: tuple[GeneratorSpeed, ...], rendered: RenderSpeed, cores: int
) -> Table:
    """Lay out rendering alone, then with the files, each beside the stock loop."""
    table = Table(f"generation, {cores} cores", "ms per frame", "frames/s")
    for column in table.columns[1:]:
        column.justify = "right"
    rows = {
        "stock, two images, left depth": rendered.stock_left_ms,
        "stock, two images, two depths": rendered.stock_ms,
        "ours, two images, two depths": rendered.ours_ms,
        "stock, images and left depth written": rendered.stock_left_ms + rendered.stock_files_ms,
        "ours, recorded with noise": _mean_ms(recorded),
    }
    for label, ms in rows.items():
        table.add_row(label, f"{ms:.1f}", f"{1e3 / ms:.1f}")
    return table


def ratio_table(
    recorded: tuple[GeneratorSpeed, ...], rendered: RenderSpeed, scaling: float
) -> Table:
    """Lay out what does not depend on the machine's speed, beside what is promised."""
    table = Table("ratio", "found", "promised")
    memory_mb = max(x.memory_mb for x in recorded)
    stock_written_ms = rendered.stock_left_ms + rendered.stock_files_ms
    for label, found, promised in (
        ("stock over ours, two images, two depths", rendered.stock_ms / rendered.ours_ms, "≥ 2"),
        (
            "the same, ours with right depth, stock without",
            rendered.stock_left_ms / rendered.ours_ms,
            "",
        ),
        ("bare renders over recording", rendered.ours_ms / _mean_ms(recorded), "≥ 0.85"),
        ("stock, written, over recording", stock_written_ms / _mean_ms(recorded), ""),
        ("two workers over one, a core each", scaling, "≥ 1.6"),
    ):
        table.add_row(label, f"{found:.2f}", promised)
    table.add_row("memory of a worker, GB", f"{memory_mb / 1024:.2f}", "< 1.5")
    return table


def length_table(cost: LengthCost) -> Table:
    """Lay out what a frame costs on a short and on a long drive, and their ratio."""
    short, long = cost.short, cost.long
    title = f"{LONG_SCENE}, CPU ms per frame"
    table = Table(title, *(f"{x.distance_m:g} m" for x in (short, long)), "ratio", "promised")
    for column in table.columns[1:4]:
        column.justify = "right"
    stretch = f"images and depth, on the first {short.distance_m:g} m"
    for label, a, b, promised in (
        ("physics", short.physics_ms, long.physics_ms, ""),
        ("images with noise, and depth", short.picture_ms, long.picture_ms, ""),
        (stretch, short.picture_ms, cost.again_ms, ""),
        ("all", short.frame_ms, long.frame_ms, "≤ 1"),
    ):
        table.add_row(label, f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}", promised)
    table.add_row("frames", str(short.frames), str(long.frames), "", "")
    memory_gb = (x.memory_mb / 1024 for x in (short, long))
    table.add_row("peak memory, GB", *(f"{x:.2f}" for x in memory_gb), "", "< 1.5")
    return table


def _mean_ms(recorded: tuple[GeneratorSpeed, ...]) -> float:
    return sum(x.frame_ms for x in recorded) / len(recorded)


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
    for label, figure in (("all, mean", np.mean), ("all, median", np.median)):
        table.add_row(label, *(f"{figure(x.frame_ms):.1f}" for x in speeds))
    table.add_row("all, 95th percentile", *(f"{np.quantile(x.frame_ms, 0.95):.1f}" for x in speeds))
    table.add_row("frames/s, median", *(f"{1e3 / np.median(x.frame_ms):.1f}" for x in speeds))
    return table


def endurance_table(estimated: dict[str, EstimatorSpeed]) -> Table:
    """Lay out what a frame costs in the first and last tenth of the sequence, and the memory."""
    speeds = list(estimated.values())
    frames = speeds[0].frames
    table = Table(f"{frames} frames, tenth by tenth", *estimated)
    for column in table.columns[1:]:
        column.justify = "right"
    tenth = max(1, frames // 10)
    ends = slice(None, tenth), slice(-tenth, None)
    for label, figure in (("median", np.median), ("95th percentile", partial(np.quantile, q=0.95))):
        first, last = ([figure(x.frame_ms[of]) for x in speeds] for of in ends)
        table.add_row(f"first tenth, {label}, ms", *(f"{x:.1f}" for x in first))
        table.add_row(f"last tenth, {label}, ms", *(f"{x:.1f}" for x in last))
        table.add_row("ratio", *(f"{b / a:.2f}" for a, b in zip(first, last, strict=True)))
    table.add_section()
    after_tenth, at_end = ([x.memory_mb[k] / 1024 for x in speeds] for k in (tenth - 1, -1))
    table.add_row("memory after a tenth, GB", *(f"{x:.2f}" for x in after_tenth))
    table.add_row("memory at the end, GB", *(f"{x:.2f}" for x in at_end))
    return table
