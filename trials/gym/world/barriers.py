"""Barriers that come down in a passage, and never upon the rover: loads, doors and gates.

A barrier that is not yet down rises while the rover is within SAFE_M of it; one that is down stays.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from math import inf

import numpy as np

from trials.gym.world.dynamic_agents import DynamicAgent
from vo.contract import se3
from vo.contract.arrays import Array

SAFE_M = 0.8
"""Distance of the rover's axle from a barrier that comes down; the rover reaches 0.38 m and brakes
within 0.25 m."""


@dataclass(frozen=True)
class Slot:
    """Rectangle on the ground that a barrier closes.

    Attributes:
        centre: (3,) world.
        yaw_rad: Direction of its depth axis, along the passage.
        half: (2,) half its depth along the passage and half its width across, metres.
    """

    centre: Array
    yaw_rad: float
    half: Array

    @property
    def corners(self) -> Array:
        """(4, 2) world x, y."""
        signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.centre[:2] + (signs * self.half) @ np.array([[c, s], [-s, c]])

    def distance_m(self, point: Array) -> float:
        """Distance of a point (2,) from the rectangle; 0 inside."""
        dx, dy = float(point[0] - self.centre[0]), float(point[1] - self.centre[1])
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        out_x = max(0.0, abs(c * dx + s * dy) - float(self.half[0]))
        out_y = max(0.0, abs(c * dy - s * dx) - float(self.half[1]))
        return math.hypot(out_x, out_y)


class Barrier(DynamicAgent):
    """Moves straight down to close a slot and up to open it; its coordinate is the height, metres.

    Attributes:
        slot: What it closes.
    """

    LIFT_M = 1.6
    SPEED_MPS = 0.8

    def __init__(self, slot: Slot, down: bool) -> None:
        self.slot = slot
        self._closed = se3.exp(np.array([0.0, 0, 0, 0, 0, slot.yaw_rad]))
        self._closed[:3, 3] = slot.centre
        super().__init__(0.0 if down else self.LIFT_M)

    @property
    def is_up(self) -> bool:
        """Whether the rover can drive underneath."""
        return self.coordinate >= self.LIFT_M

    @abstractmethod
    def _should_close(self, time_s: float, distance_m: float) -> bool:
        """Whether it closes, with the rover at a distance from the slot, unless that is unsafe."""

    def _next(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        distance_m = self.slot.distance_m(rover)
        height_m = self.coordinate
        safe = distance_m >= SAFE_M or height_m <= 0
        down = self._should_close(time_s, distance_m) and safe
        step_m = self.SPEED_MPS * elapsed_s
        return max(0.0, height_m - step_m) if down else min(self.LIFT_M, height_m + step_m)

    def _pose(self, coordinate: float) -> Array:
        T_world_mover = self._closed.copy()
        T_world_mover[2, 3] += coordinate
        return T_world_mover


class Load(Barrier):
    """A hoisted load that is set down for good, at a time or when the rover is near."""

    def __init__(self, slot: Slot, at_s: float, near_m: float) -> None:
        self._at_s, self._near_m = at_s, near_m
        super().__init__(slot, down=False)

    def reset(self) -> None:
        """Hang overhead."""
        super().reset()
        self._released = False

    def _should_close(self, time_s: float, distance_m: float) -> bool:
        self._released = self._released or time_s >= self._at_s or distance_m <= self._near_m
        return self._released


class Door(Barrier):
    """A lifting door that is open for a fraction of every period."""

    def __init__(self, slot: Slot, period_s: float, open_fraction: float, phase: float) -> None:
        self._period_s, self._open_fraction, self._phase = period_s, open_fraction, phase
        super().__init__(slot, down=phase >= open_fraction)

    def _should_close(self, time_s: float, distance_m: float) -> bool:
        return (time_s / self._period_s + self._phase) % 1 >= self._open_fraction


class Gate(Barrier):
    """Is closed from a time on until the rover has waited before it, or a request opens it."""

    ARRIVAL_M = 1.1
    """Distance of the rover's axle from the slot at which it waits before the gate."""

    def __init__(self, slot: Slot, closes_s: float, wait_s: float, lead_s: float) -> None:
        """Set the times.

        Args:
            slot: What it closes.
            closes_s: Time at which it closes.
            wait_s: It opens so long after the rover has arrived before it.
            lead_s: It opens so long after the first request.
        """
        self._closes_s, self._wait_s, self._lead_s = closes_s, wait_s, lead_s
        super().__init__(slot, down=closes_s <= 0)

    def reset(self) -> None:
        """Forget requests and arrivals."""
        super().reset()
        self._open_until_s, self._requested_s, self._arrived_s = self._closes_s, inf, inf

    def request(self, time_s: float) -> None:
        """Request it to open `lead_s` later; only the first request counts."""
        self._requested_s = min(self._requested_s, time_s)

    def keep_open(self) -> None:
        """Never close: the rover entered the road before."""
        self._open_until_s = inf

    def _should_close(self, time_s: float, distance_m: float) -> bool:
        if time_s >= self._open_until_s and distance_m <= self.ARRIVAL_M and not self.is_up:
            self._arrived_s = min(self._arrived_s, time_s)
        opens_s = min(self._requested_s + self._lead_s, self._arrived_s + self._wait_s)
        return self._open_until_s <= time_s < opens_s
