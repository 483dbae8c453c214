"""The driver: pure pursuit of a path by wheel speeds, from the rover's true pose."""

import math

import numpy as np

from sim.settings import DriveSettings
from sim.world.path import Path
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError

CONTROL_RATE_HZ = 50.0
PROGRESS_STEP_M = 0.001
ARRIVED_WITHIN_M = 0.003
TIPPED_RAD = math.radians(45)
STUCK_AFTER_S = 4.0
STUCK_WITHIN_M = 0.03


class DriveError(DriftyardError):
    """The rover fell, tipped over or got stuck; states time and position."""


class Driver:
    """Pure pursuit of a path with a stop at its end, at `CONTROL_RATE_HZ`.

    Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992: the arc
    through the point one lookahead ahead has curvature 2 y / L^2.
    """

    def __init__(self, path: Path, settings: DriveSettings) -> None:
        self._path, self._settings = path, settings
        self._progress_m, self._speed_mps = 0.0, 0.0
        self._moved_at_s, self._moved_from_m = 0.0, 0.0
        self._halt_at_m = settings.stop_every_m or math.inf
        self._halted_at_s: float | None = None
        self.arrived = False

    def command(self, T_world_body: Array, time_s: float) -> Array:
        """Return the wheel speeds, (2,) left and right in rad/s, for the true pose at a time.

        Raises:
            DriveError: If the rover lies on its side or has not moved for some seconds.
        """
        self._check(T_world_body, time_s)
        self._advance(T_world_body[:2, 3])
        left_m = self._path.length_m - self._progress_m
        self.arrived = self.arrived or left_m < ARRIVED_WITHIN_M
        if self.arrived or self._halting(time_s):
            self._speed_mps = 0.0
            return np.zeros(2)
        settings = self._settings
        curvature, ahead = self._pursue(T_world_body, left_m)
        turn_max = math.radians(settings.turn_rate_max_deg_s)
        if not ahead:  # the path leads backwards: turn on the spot
            self._speed_mps = 0.0
            return wheel_speeds(0.0, math.copysign(turn_max, curvature))
        stop_m = min(left_m, self._halt_at_m - self._progress_m)
        braking = math.sqrt(2 * settings.acceleration_mps2 * max(stop_m, 0.0))
        cornering = turn_max / max(abs(curvature), 1e-6)
        faster = self._speed_mps + settings.acceleration_mps2 / CONTROL_RATE_HZ
        self._speed_mps = min(faster, settings.speed_mps, braking, cornering)
        return wheel_speeds(self._speed_mps, self._speed_mps * curvature)

    def _halting(self, time_s: float) -> bool:
        """Whether the rover is at a halt; sets the next one at the end of the halt."""
        if self._progress_m < self._halt_at_m - ARRIVED_WITHIN_M:
            return False
        if self._halted_at_s is None:
            self._halted_at_s = time_s
        if time_s - self._halted_at_s < self._settings.stop_s:
            self._moved_at_s = time_s
            return True
        self._halt_at_m += self._settings.stop_every_m
        self._halted_at_s = None
        return False

    def _advance(self, position: Array) -> None:
        """Move the nearest point forward along the path, never back or to a far branch."""
        s = self._progress_m + np.arange(0.0, self._settings.lookahead_m, PROGRESS_STEP_M)
        s = np.minimum(s, self._path.length_m)
        distances = np.linalg.norm(self._path.at(s) - position, axis=1)
        self._progress_m = float(s[np.argmin(distances)])

    def _pursue(self, T_world_body: Array, left_m: float) -> tuple[float, bool]:
        """Return the curvature (1/m, left positive) to the point ahead, and whether it is ahead."""
        goal = self._path.at(self._progress_m + self._settings.lookahead_m)
        if left_m < self._settings.lookahead_m:  # aim past the end, along the last segment
            last = self._path.waypoints[-1] - self._path.waypoints[-2]
            goal = goal + last / np.linalg.norm(last) * (self._settings.lookahead_m - left_m)
        x, y = T_world_body[:2, :2].T @ (goal - T_world_body[:2, 3])
        return 2 * y / (x * x + y * y), bool(x > 0.3 * abs(y))

    def _check(self, T_world_body: Array, time_s: float) -> None:
        if T_world_body[2, 2] < math.cos(TIPPED_RAD):
            raise DriveError(f"the rover tipped over {where(T_world_body, time_s)}")
        if self._progress_m > self._moved_from_m + STUCK_WITHIN_M:
            self._moved_at_s, self._moved_from_m = time_s, self._progress_m
        turning_s = 360.0 / self._settings.turn_rate_max_deg_s  # on the spot, without progress
        if not self.arrived and time_s - self._moved_at_s > STUCK_AFTER_S + turning_s:
            raise DriveError(f"the rover got stuck {where(T_world_body, time_s)}")


def where(T_world_body: Array, time_s: float) -> str:
    """Return time and place of an event, for its message."""
    x, y = T_world_body[:2, 3]
    return f"at {time_s:.2f} s near ({x:.2f}, {y:.2f}) m"


def wheel_speeds(forward_mps: float, turn_radps: float) -> Array:
    """Return the (2,) wheel speeds left and right, rad/s, of a differential drive."""
    difference = turn_radps * TRACK_M / 2
    return np.array([forward_mps - difference, forward_mps + difference]) / WHEEL_RADIUS_M
