"""Carts that roll to and fro, and never into the rover."""

import math

import numpy as np

from trials.gym.world.dynamic_agents import Reacting
from vo.contract import se3
from vo.contract.arrays import Array

KEEP_M = 1.05
"""From the rover's axle to the middle of a cart, which stops before it."""
PATIENCE_S = 4.0
"""A cart that has waited so long turns back."""


class Cart(Reacting):
    """Rolls to and fro on a straight line; its coordinate is the way from the first end, metres."""

    def __init__(self, ends: Array, height_m: float, speed_mps: float, phase: float) -> None:
        """Stand somewhere on the line.

        Args:
            ends: (2, 2) world x, y.
            height_m: Of the ground.
            speed_mps: Along the line.
            phase: 0 to 1, of a way to and fro: where it begins.
        """
        self.ends, self._speed_mps, self._phase = ends, speed_mps, phase
        self.length_m = float(np.linalg.norm(ends[1] - ends[0]))
        along = (ends[1] - ends[0]) / self.length_m
        self._along = along
        self._T = se3.exp(np.array([0.0, 0, 0, 0, 0, math.atan2(along[1], along[0])]))
        self._T[2, 3] = height_m
        super().__init__(self.length_m * (1 - abs(1 - 2 * phase)))

    def begin(self) -> None:
        """Stand where it stood."""
        super().begin()
        self._sense = 1.0 if self._phase < 0.5 else -1.0
        self._waited_s = 0.0

    def _moved(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        place = self.place
        if not 0 < place + self._sense * self._speed_mps * elapsed_s < self.length_m:
            self._sense = 1.0 if place < self.length_m / 2 else -1.0
        wanted = place + self._sense * self._speed_mps * elapsed_s
        wanted = min(max(wanted, 0.0), self.length_m)
        now, then = (math.dist(rover, self.ends[0] + s * self._along) for s in (place, wanted))
        if then >= KEEP_M or then > now:
            self._waited_s = 0.0
            return wanted
        self._waited_s += elapsed_s
        if self._waited_s > PATIENCE_S:
            self._sense, self._waited_s = -self._sense, 0.0
        return place

    def _at(self, place: float) -> Array:
        T_world_mover = self._T.copy()
        T_world_mover[:2, 3] = self.ends[0] + place * self._along
        return T_world_mover
