"""Paths by arc length."""

import math
from dataclasses import dataclass

import numpy as np

from scenes.geometry.routes import arc_lengths
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError

CLOSED_WITHIN_M = 0.05
"""Largest gap between the ends of a closed route, which may be driven repeatedly."""


@dataclass(frozen=True)
class Path:
    """A polyline (N, 2) in world x, y, metres, N >= 2, with the arc length (N,) at each point."""

    waypoints: Array
    marks_m: Array

    @property
    def length_m(self) -> float:
        """Arc length from the first waypoint to the last."""
        return float(self.marks_m[-1])

    def at(self, s_m: float | Array) -> Array:
        """Return the (..., 2) points at arc lengths (...), clamped to the ends."""
        x, y = (np.interp(s_m, self.marks_m, self.waypoints[:, k]) for k in range(2))
        return np.stack([x, y], axis=-1)


def plan_path(route: Array, distance_m: float | None) -> Path:
    """Cut a route (N, 2), or repeat a closed one, to a path length; None for the route once.

    Raises:
        SettingsError: If an open route is too short, or all points are the same.
    """
    route = route[np.append(True, (np.diff(route, axis=0) != 0).any(axis=1))]
    if len(route) < 2:
        raise SettingsError("setting drive.waypoints: all points are the same")
    once = _path(route)
    if distance_m is None:
        return once
    points = route
    if distance_m > once.length_m:
        if np.linalg.norm(route[-1] - route[0]) > CLOSED_WITHIN_M:
            raise SettingsError(
                f"setting drive.distance_m: {distance_m:g} m requested, but the route is open and "
                f"{once.length_m:.1f} m long"
            )
        laps = math.ceil(distance_m / once.length_m)
        points = np.concatenate([route[:1]] + [route[1:]] * laps)
    whole = _path(points)
    keep = whole.marks_m < distance_m
    return _path(np.concatenate([whole.waypoints[keep], whole.at(distance_m)[None]]))


def _path(waypoints: Array) -> Path:
    return Path(waypoints, arc_lengths(waypoints))
