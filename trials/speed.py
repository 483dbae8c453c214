"""Measurements of speed, each meant for a process of its own; heavy imports wait for them."""

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TypeVar

import numpy as np

from trials.commands import console

WARM_FRAMES = 12
"""Shown to an estimator beforehand, so that compilation and first touches are not timed."""

T = TypeVar("T")


@dataclass(frozen=True)
class Trial:
    """What is driven, by every measurement alike.

    Attributes:
        scene: Name.
        seed: Of everything random.
        distance_m: Path length.
    """

    scene: str
    seed: int
    distance_m: float


@dataclass(frozen=True)
class EstimatorSpeed:
    """One estimator.

    Attributes:
        frames: Timed.
        frame_ms: Mean wall time of a `track` call; loading the images is not in it.
        stage_ms: Stage to its mean over all frames.
    """

    frames: int
    frame_ms: float
    stage_ms: dict[str, float]


@dataclass(frozen=True)
class GeneratorSpeed:
    """The generator.

    Attributes:
        frames: Recorded.
        frame_ms: Mean from the first finished frame to the last: rendered, encoded, hashed,
            certified and written, two images with depth and disparity.
        whole_s: With the scene, the drive and the map.
        gl: Name of the GL's renderer.
    """

    frames: int
    frame_ms: float
    whole_s: float
    gl: str


@dataclass(frozen=True)
class RenderSpeed:
    """Our renderer and the stock one on the same frames; means in milliseconds a frame.

    Attributes:
        ours_ms: Both images, both depths.
        stock_ms: Both images, left depth.
        stock_files_ms: Encoding and writing the stock frame's images, depth and disparity.
        different: Share of left pixels that differ by more than one grey level.
    """

    ours_ms: float
    stock_ms: float
    stock_files_ms: float
    different: float


def on_cores(cores: list[int], measure: Callable[..., T], *words: object) -> T:
    """Call in a fresh process that has only these cores from its first instruction on."""
    mine = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)  # a new process inherits it
    try:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            return pool.submit(measure, *words).result()
    finally:
        os.sched_setaffinity(0, mine)


def measure_generator(trial: Trial, out: Path) -> GeneratorSpeed:
    """Record the dataset `out` and watch the clock."""
    from sim.batch import build
    from sim.record import record
    from trials.commands.datasets import record_settings
    from vo.contract.dataset import read_manifest

    settings = record_settings(
        trial.scene, trial.seed, [f"drive.distance_m={trial.distance_m}"], None
    )
    finished_s: list[float] = []
    start = perf_counter()
    with console.progress_bar("generating") as progress:

        def advance(done: int, total: int) -> None:
            finished_s.append(perf_counter())
            progress(done, total)

        record(build(trial.scene, settings), settings, out, progress=advance)
    whole_s = perf_counter() - start
    frame_ms = 1e3 * (finished_s[-1] - finished_s[0]) / (len(finished_s) - 1)
    gl = read_manifest(out)["software"]["gl"]["renderer"]
    return GeneratorSpeed(len(finished_s), frame_ms, whole_s, gl)


def measure_renderers(trial: Trial, frames: int, folder: Path) -> RenderSpeed:
    """Draw the same instants of the drive with both renderers, which take turns.

    Args:
        trial: The drive.
        frames: How many to draw, evenly spread.
        folder: Where the stock frames are written.
    """
    from sim.gl import choose_backend

    # mujoco picks the backend of its own renderer when it is imported.
    os.environ["MUJOCO_GL"] = choose_backend("auto")

    from sim.batch import build
    from sim.render import StereoRenderer
    from sim.trip import make_trip
    from sim.world import build_world
    from trials.commands.datasets import record_settings
    from trials.stock import grey, render_plainly, stock_renderer, write_plainly

    settings = record_settings(
        trial.scene, trial.seed, [f"drive.distance_m={trial.distance_m}"], None
    )
    world = build_world(build(trial.scene, settings), settings)
    trip = make_trip(world, settings)
    rows: list[tuple[float, ...]] = []
    with (
        StereoRenderer(world, settings.render) as renderer,
        stock_renderer(world, settings.render) as stock,
        console.progress_bar("rendering") as progress,
    ):
        for index in np.linspace(0, len(trip) - 1, frames + 1).astype(int):
            time_ns = trip.timestamps_ns[index]
            world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
            start = perf_counter()
            left, _ = renderer.paint()
            renderer.survey()
            drawn = perf_counter()
            plain = render_plainly(stock, world)
            plainly_drawn = perf_counter()
            write_plainly(plain, world.rig, folder)
            written = perf_counter()
            unlike = np.abs(grey(plain.left).astype(int) - left) > 1
            times_s = drawn - start, plainly_drawn - drawn, written - plainly_drawn
            rows.append((*(1e3 * x for x in times_s), float(unlike.mean())))
            progress(len(rows), frames + 1)
    return RenderSpeed(*np.mean(rows[1:], axis=0).tolist())  # the first frame uploads textures


def measure_estimator(name: str, dataset: Path) -> EstimatorSpeed:
    """Run an estimator over a dataset, warm."""
    import cv2

    from trials.estimators import make_estimator
    from vo.contract.readers import open_sequence
    from vo.runner import run

    cv2.setNumThreads(1)
    sequence = open_sequence(dataset)
    warm, _ = make_estimator(name, sequence.rig)
    for i in range(min(WARM_FRAMES, len(sequence))):
        warm.track(sequence[i])
    estimator, _ = make_estimator(name, sequence.rig)
    with console.counting_bar(f"running {name}", len(sequence)) as count:
        result = run(sequence, estimator, count)
    stages = dict.fromkeys(stage for x in result.estimates for stage in x.timings_ms)
    stage_ms = {
        stage: sum(x.timings_ms.get(stage, 0.0) for x in result.estimates) / len(sequence)
        for stage in stages
    }
    return EstimatorSpeed(len(sequence), float(np.mean(result.frame_ms)), stage_ms)
