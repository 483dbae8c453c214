"""Barriers: loads, doors and gates that come down in a passage, and never upon the rover.

What is not yet down rises while the rover is within KEEP_M of its outline; what is down stays.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from math import inf

import numpy as np

from trials.gym.world.dynamic_agents import Reacting
from vo.contract import se3
from vo.contract.arrays import Array

KEEP_M = 0.8
"""From the rover's axle to a barrier's outline; the rover reaches 0.38 m and brakes within 0.25."""


@dataclass(frozen=True)
class Slot:
    """Where a barrier closes a passage.

    Attributes:
        centre: (3,) on the ground, world.
        yaw_rad: Of its depth axis, which points along the passage.
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

    def away_m(self, point: Array) -> float:
        """Distance of a point (2,) from the outline; 0 inside."""
        dx, dy = float(point[0] - self.centre[0]), float(point[1] - self.centre[1])
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        out_x = max(0.0, abs(c * dx + s * dy) - float(self.half[0]))
        out_y = max(0.0, abs(c * dy - s * dx) - float(self.half[1]))
        return math.hypot(out_x, out_y)


class Barrier(Reacting):
    """Goes straight down to close a slot and up to open it; its coordinate is the height, metres.

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
        """Whether one can drive underneath."""
        return self.place >= self.LIFT_M

    @abstractmethod
    def _wants_down(self, time_s: float, away_m: float) -> bool:
        """Whether it would close, with the rover so far from its outline."""

    def _moved(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        away_m = self.slot.away_m(rover)
        height_m = self.place
        down = self._wants_down(time_s, away_m) and (away_m >= KEEP_M or height_m <= 0)
        step_m = self.SPEED_MPS * elapsed_s
        return max(0.0, height_m - step_m) if down else min(self.LIFT_M, height_m + step_m)

    def _at(self, place: float) -> Array:
        T_world_mover = self._closed.copy()
        T_world_mover[2, 3] += place
        return T_world_mover


class Load(Barrier):
    """A load on a hoist that is set down for good, at a time or when the rover comes near."""

    def __init__(self, slot: Slot, at_s: float, near_m: float) -> None:
        self._at_s, self._near_m = at_s, near_m
        super().__init__(slot, down=False)

    def begin(self) -> None:
        """Hang overhead."""
        super().begin()
        self._let_down = False

    def _wants_down(self, time_s: float, away_m: float) -> bool:
        self._let_down = self._let_down or time_s >= self._at_s or away_m <= self._near_m
        return self._let_down


class Door(Barrier):
    """A lifting door that is open for a share of every period."""

    def __init__(self, slot: Slot, period_s: float, open_share: float, phase: float) -> None:
        self._period_s, self._open_share, self._phase = period_s, open_share, phase
        super().__init__(slot, down=phase >= open_share)

    def _wants_down(self, time_s: float, away_m: float) -> bool:
        return (time_s / self._period_s + self._phase) % 1 >= self._open_share


@dataclass
class Order:
    """What a gate is asked to do.

    Attributes:
        since_s: When it closes.
        wait_s: How long after the rover stands before it, it opens.
        lead_s: How long after a request it opens.
        requested_s: When it was asked to open.
        arrived_s: When the rover came to stand before it.
    """

    since_s: float
    wait_s: float
    lead_s: float
    requested_s: float = inf
    arrived_s: float = inf


class Gate(Barrier):
    """Is closed from a time on until the rover has waited before it, or had it opened ahead.

    Attributes:
        order: Of the present trial.
    """

    HERE_M = 1.1
    """From the rover's axle to the outline: it stands before the gate."""

    def __init__(self, slot: Slot, since_s: float, wait_s: float, lead_s: float) -> None:
        self._order = (since_s, wait_s, lead_s)
        super().__init__(slot, down=since_s <= 0)

    def begin(self) -> None:
        """Forget requests and arrivals."""
        super().begin()
        self.order = Order(*self._order)

    def request(self, time_s: float) -> None:
        """Have it open `lead_s` later; asking again changes nothing."""
        self.order.requested_s = min(self.order.requested_s, time_s)

    def waive(self) -> None:
        """Let it stay open: the rover entered the road before it closed."""
        self.order.since_s = inf

    def _wants_down(self, time_s: float, away_m: float) -> bool:
        order = self.order
        if time_s >= order.since_s and away_m <= self.HERE_M and not self.is_up:
            order.arrived_s = min(order.arrived_s, time_s)
        opens_s = min(order.requested_s + order.lead_s, order.arrived_s + order.wait_s)
        return order.since_s <= time_s < opens_s
