"""Time per frame of a long and of a short drive.

Physics simulates both drives entirely; then frames of each at even intervals are rendered
alternately. CPU time is measured, which depends less on other programs than wall time.
"""

import multiprocessing
import resource
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np

from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import NOISE, TimedDrive


@dataclass(frozen=True)
class DriveCost:
    """Time of a drive of one length.

    Attributes:
        distance_m: Length of the path.
        frames: Number of frames.
        physics_ms: CPU time of the physics per frame.
        picture_ms: CPU time of both images with noise and both depths per frame.
        memory_mb: Largest resident size of the process.
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
    """A short drive and a long one over the same route.

    Attributes:
        short: The short drive.
        long: The long drive.
        again_ms: `picture_ms` of the long drive on the part that it shares with the short one.
    """

    short: DriveCost
    long: DriveCost
    again_ms: float


def measure_lengths(
    short: TimedDrive, long: TimedDrive, frames: int, bar: ProgressBar = no_progress
) -> LengthCost:
    """Simulate both drives, and draw the same number of frames of each.

    Args:
        short: The short drive.
        long: The long drive, on the same route.
        frames: Number of frames of each to draw.
        bar: Shows progress.
    """
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, spawn) as one,
        ProcessPoolExecutor(1, spawn) as other,
        bar("short and long") as progress,
    ):
        driven = [one.submit(_drive, short), other.submit(_drive, long)]
        (short_frames, short_ms), (long_frames, long_ms) = (x.result() for x in driven)
        rows: list[tuple[float, float, float]] = []
        for k, share in enumerate(np.linspace(0, 1, frames + 1)):
            again = share * short_frames / long_frames
            turns = (one, share), (other, share), (other, again)
            a, b, c = (process.submit(_draw, place).result() for process, place in turns)
            rows.append((a, b, c))
            progress(k, frames)
        memory_mb = [process.submit(_memory_mb).result() for process in (one, other)]
    drawn_ms = np.mean(rows[1:], axis=0).tolist()  # the first uploads textures
    return LengthCost(
        DriveCost(short.distance_m, short_frames, short_ms, drawn_ms[0], memory_mb[0]),
        DriveCost(long.distance_m, long_frames, long_ms, drawn_ms[1], memory_mb[1]),
        drawn_ms[2],
    )


@dataclass(frozen=True)
class _Resident:
    """Camera and trip in a process of its own, open as long as the process lives."""

    trip: Any
    camera: Any
    renderer: Any
    opened: Any


_resident: _Resident


def _drive(drive: TimedDrive) -> tuple[int, float]:
    """Return the number of frames, and milliseconds of physics per frame."""
    from sim.batch import build
    from sim.camera.camera import StereoCamera
    from sim.camera.render import StereoRenderer
    from sim.world.trip import make_trip
    from sim.world.world import build_world

    global _resident
    settings = drive.settings(*NOISE)
    world = build_world(build(drive.scene, settings), settings)
    start_s = process_time()
    trip = make_trip(world, settings)
    frame_ms = 1e3 * (process_time() - start_s) / len(trip)
    opened = StereoRenderer(world, settings.render)
    _resident = _Resident(trip, StereoCamera(world, settings), opened.__enter__(), opened)
    return len(trip), frame_ms


def _draw(share: float) -> float:
    """Return milliseconds of the frame at a fraction of the trip."""
    trip = _resident.trip
    only = np.arange(len(trip)) == round(share * (len(trip) - 1))
    start_s = process_time()
    (capture,) = _resident.camera.captures(replace(trip, delivered=only), _resident.renderer)
    _resident.camera.form_images(capture)
    return 1e3 * (process_time() - start_s)


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
