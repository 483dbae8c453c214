"""The drive of all speed measurements, and the process in which each is made."""

import multiprocessing
import os
import resource
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from sim.batch import build
from sim.camera_names import IDEAL
from sim.settings import RecordSettings
from sim.world.trip import Trip, make_trip
from sim.world.world import World, build_world
from trials.execution.recording_settings import recording_settings

NOISE = ("sensor.full_well=6000", "sensor.read_noise=15")
"""Overrides for sensor noise."""
SPAWN = multiprocessing.get_context("spawn")

T = TypeVar("T")


@dataclass(frozen=True)
class TimedDrive:
    """Drive of some length through a scene that is timed, by the ideal camera.

    Its images are what a stock renderer draws, too. The seed is that of the recording.
    """

    scene: str
    seed: int
    distance_m: float

    def settings(self, *overrides: str) -> RecordSettings:
        """Resolve the settings of the recording."""
        distance = f"drive.distance_m={self.distance_m}"
        return recording_settings(self.scene, self.seed, [distance, *overrides], camera=IDEAL)

    def build(self, settings: RecordSettings) -> tuple[World, Trip]:
        """Build the world, and simulate the drive without rendering."""
        world = build_world(build(self.scene, settings), settings)
        return world, make_trip(world, settings)


def on_cores(cores: list[int], measure: Callable[..., T], *words: object) -> T:
    """Call a function in a new process that is restricted to these cores from its start."""
    mine = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)  # a new process inherits it
    try:
        with ProcessPoolExecutor(1, SPAWN) as pool:
            return pool.submit(measure, *words).result()
    finally:
        os.sched_setaffinity(0, mine)


def peak_memory_mb() -> float:
    """Return the largest resident size of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
