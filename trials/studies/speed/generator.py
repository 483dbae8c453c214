"""Speed of recording: by one worker, by one for each core, and on a long and on a short drive.

Of the latter two, physics simulates both entirely; then frames of each at even intervals are
rendered alternately. CPU time is measured, which depends less on other programs than wall time.
"""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from types import SimpleNamespace
from typing import Any

import numpy as np

from sim.batch import build
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.record import record
from sim.world.trip import make_trip
from sim.world.world import build_world
from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import NOISE, SPAWN, TimedDrive, on_cores, peak_memory_mb
from vo.contract.dataset import read_manifest

opened: Any = SimpleNamespace()
"""Trip, camera and renderer of this process, which remain open as long as it lives."""


@dataclass(frozen=True)
class GeneratorSpeed:
    """Speed of the generator.

    Attributes:
        frame_ms: Mean from the first finished frame to the last: rendered, noise added, encoded,
            hashed, certified and written, two images with depth and disparity.
        whole_s: Wall time with scene, drive and map.
        memory_mb: Largest resident size of the process.
    """

    frames: int
    frame_ms: float
    whole_s: float
    memory_mb: float
    gl: str


def measure_generator(
    drive: TimedDrive, out: Path, bar: ProgressBar = no_progress
) -> GeneratorSpeed:
    """Record the dataset `out` with sensor noise, and time it."""
    settings = drive.settings(*NOISE)
    finished_s: list[float] = []
    start = perf_counter()
    with bar("generating") as progress:

        def advance(done: int, total: int) -> None:
            finished_s.append(perf_counter())
            progress(done, total)

        record(build(drive.scene, settings), settings, out, progress=advance)
    whole_s = perf_counter() - start
    frame_ms = 1e3 * (finished_s[-1] - finished_s[0]) / (len(finished_s) - 1)
    gl = read_manifest(out)["software"]["gl"]["renderer"]
    return GeneratorSpeed(len(finished_s), frame_ms, whole_s, peak_memory_mb(), gl)


def measure_scaling(drive: TimedDrive, cores: list[int], folder: Path) -> float:
    """Return the frame rate of one generator per core over that of one, each on its own core."""
    alone = on_cores(cores[:1], measure_generator, drive, folder / "alone")
    with ThreadPoolExecutor(len(cores)) as pool:  # each thread has its own affinity
        jobs = [
            pool.submit(on_cores, [core], measure_generator, drive, folder / f"core_{core}")
            for core in cores
        ]
        together = [job.result() for job in jobs]
    return sum(alone.frame_ms / each.frame_ms for each in together)


@dataclass(frozen=True)
class DriveCost:
    """CPU time per frame of a drive of one length, and largest resident size of its process.

    A picture is both images with noise and both depths.
    """

    distance_m: float
    frames: int
    physics_ms: float
    picture_ms: float
    memory_mb: float

    @property
    def frame_ms(self) -> float:
        """CPU time per frame."""
        return self.physics_ms + self.picture_ms


@dataclass(frozen=True)
class LengthCost:
    """A short and a long drive, and `picture_ms` of the long one on the part that they share."""

    short: DriveCost
    long: DriveCost
    again_ms: float


def measure_lengths(
    short: TimedDrive, long: TimedDrive, frames: int, bar: ProgressBar = no_progress
) -> LengthCost:
    """Simulate a short and a long drive over the same route, and draw `frames` frames of each."""
    with (
        ProcessPoolExecutor(1, SPAWN) as one,
        ProcessPoolExecutor(1, SPAWN) as other,
        bar("short and long") as progress,
    ):
        driven = [one.submit(_drive, short), other.submit(_drive, long)]
        (short_frames, short_ms), (long_frames, long_ms) = (x.result() for x in driven)
        rows: list[tuple[float, ...]] = []
        for k, share in enumerate(np.linspace(0, 1, frames + 1)):
            again = share * short_frames / long_frames
            turns = (one, share), (other, share), (other, again)
            rows.append(tuple(process.submit(_draw, at).result() for process, at in turns))
            progress(k, frames)
        memory_mb = [process.submit(peak_memory_mb).result() for process in (one, other)]
    drawn_ms = np.mean(rows[1:], axis=0).tolist()  # the first uploads textures
    return LengthCost(
        DriveCost(short.distance_m, short_frames, short_ms, drawn_ms[0], memory_mb[0]),
        DriveCost(long.distance_m, long_frames, long_ms, drawn_ms[1], memory_mb[1]),
        drawn_ms[2],
    )


def _drive(drive: TimedDrive) -> tuple[int, float]:
    """Return the number of frames, and milliseconds of physics per frame."""
    settings = drive.settings(*NOISE)
    world = build_world(build(drive.scene, settings), settings)
    start_s = process_time()
    opened.trip = make_trip(world, settings)
    frame_ms = 1e3 * (process_time() - start_s) / len(opened.trip)
    opened.context = StereoRenderer(world, settings.render)
    opened.renderer = opened.context.__enter__()
    opened.camera = StereoCamera(world, settings)
    return len(opened.trip), frame_ms


def _draw(share: float) -> float:
    """Return milliseconds of the frame at a fraction of the trip."""
    trip = opened.trip
    only = np.arange(len(trip)) == round(share * (len(trip) - 1))
    start_s = process_time()
    (capture,) = opened.camera.captures(replace(trip, delivered=only), opened.renderer)
    opened.camera.form_images(capture)
    return 1e3 * (process_time() - start_s)
