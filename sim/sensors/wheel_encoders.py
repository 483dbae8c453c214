"""Wheel encoders: whole ticks of the wheel angles, at the encoders' rate."""

import math
from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array, Indices


@dataclass
class Encoders:
    """Two counters, read at the first physics step at or after each sampling time.

    Readings are times of steps, and (left, right) ticks since the start, forward positive.
    """

    ticks_per_turn: int
    rate_hz: float
    times_ns: list[int] = field(default_factory=list[int])
    counts: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    def next_step(self, timestep_s: float) -> int:
        """Return the physics step of the next reading, counted from the first reading."""
        return math.ceil(len(self.counts) / (self.rate_hz * timestep_s) - 1e-9)

    def read(self, time_ns: int, wheel_angles_rad: Array) -> None:
        """Take a reading of the angles, (2,) left and right."""
        left, right = ticks(wheel_angles_rad, self.ticks_per_turn)
        self.times_ns.append(time_ns)
        self.counts.append((int(left), int(right)))


def ticks(wheel_angles_rad: Array, ticks_per_turn: int) -> Indices:
    """Quantise angles (...) to whole ticks, rounding down."""
    turns = np.asarray(wheel_angles_rad) / (2 * np.pi)
    return np.floor(turns * ticks_per_turn).astype(np.int64)
