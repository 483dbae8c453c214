"""The things that move in a trial and react to the rover: loads, doors, gates and carts.

An agent has one coordinate, which it changes at the end of every stretch of physics. It records
the coordinate over time, so that the images of a trial can be rendered again. A barrier never comes
down upon the rover, and a cart stops before it.
"""

import math
from abc import ABC, abstractmethod
from array import array
from dataclasses import dataclass
from math import inf

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array


class DynamicAgent(ABC):
    """A motion, as in `Scene.movers`, that depends on the rover."""

    def __init__(self, initial: float) -> None:
        """Stay at the coordinate `initial` until the first call of `advance`."""
        self._initial = initial
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._times_ns, self._coordinates = array("q"), array("d")

    @property
    def coordinate(self) -> float:
        """The present coordinate."""
        return self._coordinates[-1] if self._coordinates else self._initial

    def advance(self, time_s: float, rover: Array) -> None:
        """Move on to a later time, with the rover's axle at (2,) x, y."""
        time_ns = round(time_s * 1e9)
        elapsed_s = (time_ns - self._times_ns[-1]) * 1e-9 if self._times_ns else 0.0
        coordinate = self._next(time_s, elapsed_s, rover)
        self._times_ns.append(time_ns)
        self._coordinates.append(coordinate)

    def __call__(self, time_s: float) -> Array:
        """(4, 4) T_world_mover at a past time, interpolated; at rest before and after."""
        if not self._times_ns:
            return self._pose(self._initial)
        return self._pose(float(np.interp(round(time_s * 1e9), self._times_ns, self._coordinates)))

    @abstractmethod
    def _next(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        """The coordinate at a time, `elapsed_s` after the last one."""

    @abstractmethod
    def _pose(self, coordinate: float) -> Array:
        """(4, 4) T_world_mover at a coordinate."""


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

    While the rover is within SAFE_M, one that is not yet down rises, and one that is down stays.
    """

    LIFT_M = 1.6
    SPEED_MPS = 0.8
    SAFE_M = 0.8
    """Distance of the rover's axle; the rover reaches 0.38 m and brakes within 0.25 m."""

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
        safe = distance_m >= self.SAFE_M or height_m <= 0
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
        """Close at a time; open `wait_s` after the rover's arrival or `lead_s` after a request."""
        self._closes_s, self._wait_s, self._lead_s = closes_s, wait_s, lead_s
        super().__init__(slot, down=closes_s <= 0)

    def reset(self) -> None:
        """Forget requests and arrivals."""
        super().reset()
        self._open_until_s, self._requested_s, self._arrived_s = self._closes_s, inf, inf

    def request(self, time_s: float) -> None:
        """Request it to open `lead_s` later; only the first request counts."""
        self._requested_s = min(self._requested_s, time_s)

    def enter(self, time_s: float) -> None:
        """Stay open for good if the rover enters the road before the gate closes."""
        if time_s < self._closes_s:
            self._open_until_s = inf

    def _should_close(self, time_s: float, distance_m: float) -> bool:
        if time_s >= self._open_until_s and distance_m <= self.ARRIVAL_M and not self.is_up:
            self._arrived_s = min(self._arrived_s, time_s)
        opens_s = min(self._requested_s + self._lead_s, self._arrived_s + self._wait_s)
        return self._open_until_s <= time_s < opens_s


class Cart(DynamicAgent):
    """Rolls to and fro on a straight line; its coordinate is the distance from the first end, m."""

    SAFE_M = 1.05
    """Distance from the rover's axle to its middle that it keeps."""
    MAX_WAIT_S = 4.0
    """Time after which it turns back when it waits."""

    def __init__(self, ends: Array, height_m: float, speed_mps: float, phase: float) -> None:
        """Stand between the ends (2, 2), world x, y; the phase, 0 to 1, is that of the period."""
        self.ends, self._speed_mps, self._phase = ends, speed_mps, phase
        self.length_m = float(np.linalg.norm(ends[1] - ends[0]))
        self._along = (ends[1] - ends[0]) / self.length_m
        self._T = se3.exp(np.array([0.0, 0, 0, 0, 0, math.atan2(*self._along[::-1])]))
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
        if then >= self.SAFE_M or then > now:
            self._waited_s = 0.0
            return wanted
        self._waited_s += elapsed_s
        if self._waited_s > self.MAX_WAIT_S:
            self._direction, self._waited_s = -self._direction, 0.0
        return here

    def _pose(self, coordinate: float) -> Array:
        T_world_mover = self._T.copy()
        T_world_mover[:2, 3] = self.ends[0] + coordinate * self._along
        return T_world_mover
