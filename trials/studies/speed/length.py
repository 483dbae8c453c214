"""Time per frame of a long and of a short drive.

Physics simulates both drives entirely; then frames of each at even intervals are rendered
alternately. CPU time is measured, which depends less on other programs than wall time.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from time import process_time
from types import SimpleNamespace
from typing import Any

import numpy as np

from sim.batch import build
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.world.trip import make_trip
from sim.world.world import build_world
from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import NOISE, SPAWN, TimedDrive, peak_memory_mb

opened: Any = SimpleNamespace()
"""Trip, camera and renderer of this process, which remain open as long as it lives."""


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
