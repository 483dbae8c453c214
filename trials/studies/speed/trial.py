"""What every measurement of speed drives, and the process of its own that it is made in."""

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from sim.settings import RecordSettings
    from sim.world.trip import Trip
    from sim.world.world import World

NOISE = ("sensor.full_well=6000", "sensor.read_noise=15")
"""What the recorded camera adds."""

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

    def settings(self, *overrides: str) -> "RecordSettings":
        """Resolve what is recorded."""
        from trials.execution.recording_settings import recording_settings

        distance = f"drive.distance_m={self.distance_m}"
        return recording_settings(self.scene, self.seed, [distance, *overrides])

    def drive(self) -> "tuple[World, Trip]":
        """Build the world and go through it, in physics alone."""
        from sim.batch import build
        from sim.world.trip import make_trip
        from sim.world.world import build_world

        settings = self.settings()
        world = build_world(build(self.scene, settings), settings)
        return world, make_trip(world, settings)


def on_cores(cores: list[int], measure: Callable[..., T], *words: object) -> T:
    """Call in a fresh process that has only these cores from its first instruction on."""
    mine = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)  # a new process inherits it
    try:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            return pool.submit(measure, *words).result()
    finally:
        os.sched_setaffinity(0, mine)
