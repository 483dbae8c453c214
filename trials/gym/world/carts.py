"""Carts that roll to and fro, and stop before the rover."""

import math

import numpy as np

from trials.gym.world.dynamic_agents import DynamicAgent
from vo.contract import se3
from vo.contract.arrays import Array

SAFE_M = 1.05
"""Distance from the rover's axle to the middle of a cart that a cart keeps."""
MAX_WAIT_S = 4.0
"""Time after which a waiting cart turns back."""


class Cart(DynamicAgent):
    """Rolls to and fro on a straight line; its coordinate is the distance from the first end, m."""

    def __init__(self, ends: Array, height_m: float, speed_mps: float, phase: float) -> None:
        """Stand between the ends (2, 2), world x, y; the phase, 0 to 1, is that of the period."""
        self.ends, self._speed_mps, self._phase = ends, speed_mps, phase
        self.length_m = float(np.linalg.norm(ends[1] - ends[0]))
        along = (ends[1] - ends[0]) / self.length_m
        self._along = along
        self._T = se3.exp(np.array([0.0, 0, 0, 0, 0, math.atan2(along[1], along[0])]))
        self._T[2, 3] = height_m
        super().__init__(self.length_m * (1 - abs(1 - 2 * phase)))

    def reset(self) -> None:
        """Return to the initial position and direction."""
        super().reset()
        self._direction = 1.0 if self._phase < 0.5 else -1.0
        self._waited_s = 0.0

    def _next(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        here = self.coordinate
        if not 0 < here + self._direction * self._speed_mps * elapsed_s < self.length_m:
            self._direction = 1.0 if here < self.length_m / 2 else -1.0
        wanted = here + self._direction * self._speed_mps * elapsed_s
        wanted = min(max(wanted, 0.0), self.length_m)
        now, then = (math.dist(rover, self.ends[0] + s * self._along) for s in (here, wanted))
        if then >= SAFE_M or then > now:
            self._waited_s = 0.0
            return wanted
        self._waited_s += elapsed_s
        if self._waited_s > MAX_WAIT_S:
            self._direction, self._waited_s = -self._direction, 0.0
        return here

    def _pose(self, coordinate: float) -> Array:
        T_world_mover = self._T.copy()
        T_world_mover[:2, 3] = self.ends[0] + coordinate * self._along
        return T_world_mover
