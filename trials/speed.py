"""Measurements of speed, each meant for a process of its own; heavy imports wait for them."""

import multiprocessing
import os
import resource
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from trials.commands import console
from vo.contract.arrays import Image

if TYPE_CHECKING:
    from sim.settings import RecordSettings

NOISE = ("sensor.full_well=6000", "sensor.read_noise=15")
"""What the recorded camera adds."""
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
        frame_ms: Mean from the first finished frame to the last: rendered, noise added, encoded,
            hashed, certified and written, two images with depth and disparity.
        whole_s: With the scene, the drive and the map.
        memory_mb: Largest resident size of the process.
        gl: Name of the GL's renderer.
    """

    frames: int
    frame_ms: float
    whole_s: float
    memory_mb: float
    gl: str


@dataclass(frozen=True)
class RenderSpeed:
    """Our renderer and the stock one on the same frames; medians in milliseconds a frame.

    Attributes:
        ours_ms: Both images, both depths, both identities.
        stock_ms: Both images, both depths.
        stock_left_ms: Both images, left depth.
        stock_files_ms: Encoding and writing the stock frame's images, depth and disparity.
        different_grey: Mean difference of the left images.
    """

    ours_ms: float
    stock_ms: float
    stock_left_ms: float
    stock_files_ms: float
    different_grey: float


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
    """Record the dataset `out` with sensor noise and watch the clock."""
    from sim.batch import build
    from sim.record import record
    from vo.contract.dataset import read_manifest

    settings = _settings(trial, NOISE)
    finished_s: list[float] = []
    start = perf_counter()
    with console.progress_bar("generating") as progress:

        def advance(done: int, total: int) -> None:
            finished_s.append(perf_counter())
            progress(done, total)

        record(build(trial.scene, settings), settings, out, progress=advance)
    whole_s = perf_counter() - start
    frame_ms = 1e3 * (finished_s[-1] - finished_s[0]) / (len(finished_s) - 1)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    gl = read_manifest(out)["software"]["gl"]["renderer"]
    return GeneratorSpeed(len(finished_s), frame_ms, whole_s, memory_mb, gl)


def measure_scaling(trial: Trial, cores: list[int], folder: Path) -> float:
    """Frame rate of one generator a core over that of a single one, each held to its core."""
    alone = on_cores(cores[:1], measure_generator, trial, folder / "alone")
    with ThreadPoolExecutor(len(cores)) as pool:  # each thread has its own affinity
        jobs = [
            pool.submit(on_cores, [core], measure_generator, trial, folder / f"core_{core}")
            for core in cores
        ]
        together = [job.result() for job in jobs]
    return sum(alone.frame_ms / each.frame_ms for each in together)


def measure_renderers(trial: Trial, frames: int, folder: Path) -> RenderSpeed:
    """Draw the same instants of the drive with both renderers, which take turns.

    Each has a process of its own, because what one sets for the driver would help the other.

    Args:
        trial: The drive.
        frames: How many to draw, evenly spread.
        folder: Where the stock frames are written.
    """
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, spawn, _open_ours, (trial,)) as ours,
        ProcessPoolExecutor(1, spawn, _open_stock, (trial,)) as stock,
        console.progress_bar("rendering") as progress,
    ):
        rows: list[tuple[float, ...]] = []
        for k, share in enumerate(np.linspace(0, 1, frames + 1)):
            ours_ms, left = ours.submit(_draw_ours, share).result()
            stock_ms, plain_left = stock.submit(_draw_stock, share, folder).result()
            different = float(np.abs(left.astype(int) - plain_left).mean())
            rows.append((ours_ms, *stock_ms, different))
            progress(k, frames)
    return RenderSpeed(*np.median(rows[1:], axis=0).tolist())  # the first uploads textures


@dataclass(frozen=True)
class _Stand:
    """A renderer before a world, in a process of its own, open as long as the process lives."""

    world: Any
    trip: Any
    renderer: Any
    opened: Any

    def place(self, share: float) -> None:
        """Bring the world to a share of the trip."""
        time_ns = self.trip.timestamps_ns[round(share * (len(self.trip) - 1))]
        states = self.trip.states.at(self.world.model, time_ns)
        self.world.place(time_ns * 1e-9, states)


_stand: _Stand


def _open_ours(trial: Trial) -> None:
    from sim.render import StereoRenderer

    global _stand
    world, trip = _drive(trial)
    opened = StereoRenderer(world, _settings(trial).render)
    _stand = _Stand(world, trip, opened.__enter__(), opened)


def _open_stock(trial: Trial) -> None:
    from sim.gl import choose_backend

    # mujoco picks the backend of its own renderer when it is imported.
    os.environ["MUJOCO_GL"] = choose_backend("auto")
    from trials.stock import stock_renderer

    global _stand
    world, trip = _drive(trial)
    opened = stock_renderer(world, _settings(trial).render)
    _stand = _Stand(world, trip, opened.__enter__(), opened)


def _draw_ours(share: float) -> tuple[float, Image]:
    """Milliseconds, and the left image."""
    _stand.place(share)
    start = perf_counter()
    left, _ = _stand.renderer.paint()
    _stand.renderer.survey()
    return 1e3 * (perf_counter() - start), left


def _draw_stock(share: float, folder: Path) -> tuple[tuple[float, float, float], Image]:
    """Milliseconds with both depths, with the left one, and of the files; the left image."""
    from trials.stock import grey, render_plainly, write_plainly

    _stand.place(share)
    start = perf_counter()
    render_plainly(_stand.renderer, _stand.world, depths=2)
    both = perf_counter()
    plain = render_plainly(_stand.renderer, _stand.world, depths=1)
    left = perf_counter()
    write_plainly(plain, _stand.world.rig, folder)
    written = perf_counter()
    times_ms = 1e3 * (both - start), 1e3 * (left - both), 1e3 * (written - left)
    return times_ms, grey(plain.left)


def _drive(trial: Trial) -> tuple[Any, Any]:
    from sim.batch import build
    from sim.trip import make_trip
    from sim.world import build_world

    settings = _settings(trial)
    world = build_world(build(trial.scene, settings), settings)
    return world, make_trip(world, settings)


def _settings(trial: Trial, overrides: tuple[str, ...] = ()) -> "RecordSettings":
    from trials.commands.datasets import record_settings

    distance = f"drive.distance_m={trial.distance_m}"
    return record_settings(trial.scene, trial.seed, [distance, *overrides])


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
