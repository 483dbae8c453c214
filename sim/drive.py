"""The driver: pure pursuit of a route by wheel speeds, from the rover's true pose."""

import math
from dataclasses import dataclass

import numpy as np

from sim.rover import TRACK_M, WHEEL_RADIUS_M
from sim.settings import DriveSettings
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError, SettingsError

CONTROL_RATE_HZ = 50.0
PROGRESS_STEP_M = 0.001
CLOSED_WITHIN_M = 0.05
"""A route whose ends are closer than this may be driven around repeatedly."""
ARRIVED_WITHIN_M = 0.003
TIPPED_RAD = math.radians(45)
STUCK_AFTER_S = 4.0
STUCK_WITHIN_M = 0.03


class DriveError(DriftyardError):
    """The rover tipped over, got stuck or left its route; says when."""


@dataclass(frozen=True)
class Path:
    """A polyline to drive along, by arc length.

    Attributes:
        waypoints: (N, 2) world x, y in metres, N >= 2.
        marks_m: (N,) arc length at each waypoint, from 0.
    """

    waypoints: Array
    marks_m: Array

    @property
    def length_m(self) -> float:
        """From the first waypoint to the last."""
        return float(self.marks_m[-1])

    def at(self, s_m: float | Array) -> Array:
        """Return the (..., 2) points at arc lengths (...), clamped to the ends."""
        x, y = (np.interp(s_m, self.marks_m, self.waypoints[:, k]) for k in range(2))
        return np.stack([x, y], axis=-1)


def plan_path(route: Array, distance_m: float | None) -> Path:
    """Cut a route, or repeat a closed one, to the distance asked for.

    Args:
        route: (N, 2) waypoints in metres.
        distance_m: Path length; None for the route once.

    Raises:
        SettingsError: If an open route is shorter than that.
    """
    once = _path(route)
    if distance_m is None:
        return once
    points = route
    if distance_m > once.length_m:
        if np.linalg.norm(route[-1] - route[0]) > CLOSED_WITHIN_M:
            raise SettingsError(
                f"setting drive.distance_m: {distance_m:g} m asked for, but the route is open and "
                f"{once.length_m:.1f} m long"
            )
        laps = math.ceil(distance_m / once.length_m)
        points = np.concatenate([route[:1]] + [route[1:]] * laps)
    whole = _path(points)
    keep = whole.marks_m < distance_m
    return _path(np.concatenate([whole.waypoints[keep], whole.at(distance_m)[None]]))


class Driver:
    """Follows a path and stops at its end; give it the pose at `CONTROL_RATE_HZ`.

    Source:
        Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992: the arc
        through the point one lookahead ahead has curvature 2 y / L^2.
    """

    def __init__(self, path: Path, settings: DriveSettings) -> None:
        self._path = path
        self._settings = settings
        self._progress_m = 0.0
        self._speed_mps = 0.0
        self._moved_at_s = 0.0
        self._moved_from_m = 0.0
        self.arrived = False

    def command(self, T_world_body: Array, time_s: float) -> Array:
        """Return the wheel speeds to ask for now, (2,) left and right in rad/s.

        Args:
            T_world_body: (4, 4) true pose.
            time_s: For the messages, and to notice standing still.

        Raises:
            DriveError: If the rover lies on its side or has not moved for some seconds.
        """
        self._check(T_world_body, time_s)
        self._advance(T_world_body[:2, 3])
        left_m = self._path.length_m - self._progress_m
        self.arrived = self.arrived or left_m < ARRIVED_WITHIN_M
        if self.arrived:
            return np.zeros(2)
        settings = self._settings
        curvature, ahead = self._pursue(T_world_body, left_m)
        turn_max = math.radians(settings.turn_rate_max_deg_s)
        if not ahead:  # the path leads backwards: turn on the spot
            self._speed_mps = 0.0
            return wheel_speeds(0.0, math.copysign(turn_max, curvature))
        braking = math.sqrt(2 * settings.acceleration_mps2 * left_m)
        cornering = turn_max / max(abs(curvature), 1e-6)
        faster = self._speed_mps + settings.acceleration_mps2 / CONTROL_RATE_HZ
        self._speed_mps = min(faster, settings.speed_mps, braking, cornering)
        return wheel_speeds(self._speed_mps, self._speed_mps * curvature)

    def _advance(self, position: Array) -> None:
        """Move the nearest point forward along the path, never back and never to a far branch."""
        s = self._progress_m + np.arange(0.0, self._settings.lookahead_m, PROGRESS_STEP_M)
        s = np.minimum(s, self._path.length_m)
        distances = np.linalg.norm(self._path.at(s) - position, axis=1)
        self._progress_m = float(s[np.argmin(distances)])

    def _pursue(self, T_world_body: Array, left_m: float) -> tuple[float, bool]:
        """Curvature (1/m, left positive) towards the point ahead, and whether it lies ahead."""
        goal = self._path.at(self._progress_m + self._settings.lookahead_m)
        if left_m < self._settings.lookahead_m:  # aim past the end, along the last segment
            last = self._path.waypoints[-1] - self._path.waypoints[-2]
            goal = goal + last / np.linalg.norm(last) * (self._settings.lookahead_m - left_m)
        x, y = T_world_body[:2, :2].T @ (goal - T_world_body[:2, 3])
        return 2 * y / (x * x + y * y), bool(x > 0.3 * abs(y))

    def _check(self, T_world_body: Array, time_s: float) -> None:
        x, y = T_world_body[:2, 3]
        if T_world_body[2, 2] < math.cos(TIPPED_RAD):
            raise DriveError(f"the rover tipped over at {time_s:.2f} s near ({x:.2f}, {y:.2f}) m")
        if self._progress_m > self._moved_from_m + STUCK_WITHIN_M:
            self._moved_at_s, self._moved_from_m = time_s, self._progress_m
        if not self.arrived and time_s - self._moved_at_s > STUCK_AFTER_S + self._turning_s:
            raise DriveError(f"the rover got stuck at {time_s:.2f} s near ({x:.2f}, {y:.2f}) m")

    @property
    def _turning_s(self) -> float:
        """Longest time that a turn on the spot may take without progress."""
        return 360.0 / self._settings.turn_rate_max_deg_s


def wheel_speeds(forward_mps: float, turn_radps: float) -> Array:
    """Differential drive: (2,) wheel speeds left and right, rad/s."""
    difference = turn_radps * TRACK_M / 2
    return np.array([forward_mps - difference, forward_mps + difference]) / WHEEL_RADIUS_M


def _path(waypoints: Array) -> Path:
    steps = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    return Path(waypoints, np.concatenate([[0.0], np.cumsum(steps)]))
