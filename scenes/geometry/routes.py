"""Routes: closed polygons with rounded corners, sampled densely, and coordinates along them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scenes.geometry.mesh import Mesh
from vo.contract.arrays import Array


def rounded_loop(corners: Array, radius_m: float, step_m: float = 0.1) -> Array:
    """Round the corners of a closed polygon and sample it about every `step_m`.

    The corners (K, 2) are x, y in driving order, metres, K >= 3. The waypoints (N, 2) begin and end
    in the middle of the edge from the last corner to the first.

    Raises:
        ValueError: If an edge is too short for the arcs at its ends.
    """
    path = [(corners[-1] + corners[0]) / 2]
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    cut = np.array([_cut(*abc, radius_m) for abc in zip(before, corners, after, strict=True)])
    if np.any(cut + np.roll(cut, -1) > np.linalg.norm(after - corners, axis=1)):
        raise ValueError(f"a route edge is too short for arcs of {radius_m} m")
    for a, b, c, length in zip(before, corners, after, cut, strict=True):
        path.extend(_arc(a, b, c, length, radius_m))
    path.append(path[0])
    return resampled(np.array(path), step_m)


def arc_lengths(path: Array) -> Array:
    """Measure the distance along (N, 2) points from the first to each of them: (N,) metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def resampled(path: Array, step_m: float) -> Array:
    """Sample (N, 2) a polyline at even spacing near `step_m`, both ends kept."""
    along = arc_lengths(path)
    at = np.linspace(0, along[-1], max(2, round(along[-1] / step_m) + 1))
    return np.stack([np.interp(at, along, path[:, i]) for i in (0, 1)], axis=1)


def route_length(route: Array) -> float:
    """Measure the length of (N, 2) waypoints in metres."""
    return float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())


def _cut(a: Array, b: Array, c: Array, radius_m: float) -> float:
    """Return the distance from corner b at which its arc begins and ends: r tan(turn / 2)."""
    u, v = b - a, c - b
    turn = np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)
    return float(radius_m * np.tan(abs(turn) / 2))


def _arc(a: Array, b: Array, c: Array, length: float, radius_m: float) -> list[Array]:
    """Sample the arc of the circle that touches both edges at b, in 3 degree steps."""
    u, v = (b - a) / np.linalg.norm(b - a), (c - b) / np.linalg.norm(c - b)
    turn = np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)
    if abs(turn) < 1e-6:
        return [b]
    start = b - length * u
    left = np.sign(turn) * np.array([-u[1], u[0]])
    angles = np.linspace(0, abs(turn), max(2, int(np.degrees(abs(turn)) / 3)))
    sine, cosine = np.sin(angles)[:, None], np.cos(angles)[:, None]
    return list(start + radius_m * (sine * u + (1 - cosine) * left))


def sharp_loop(corners: Array, step_m: float = 0.1) -> Array:
    """Sample the closed polygon of (K, 2) corners, metres, each of which stays a waypoint.

    The waypoints (N, 2) are about `step_m` apart; the first and the last are the middle of the edge
    from the last corner to the first.
    """
    start = (corners[-1:] + corners[:1]) / 2
    ends = np.concatenate([start, corners, start])
    edges = [resampled(ends[k : k + 2], step_m)[:-1] for k in range(len(ends) - 1)]
    return np.concatenate([*edges, start])


@dataclass(frozen=True)
class Ribbon:
    """Coordinates along a closed route.

    Attributes:
        route: (N, 2) waypoints in metres, the last equal to the first.
    """

    route: Array

    @cached_property
    def marks_m(self) -> Array:
        """Distance along the route to each waypoint: (N,)."""
        return arc_lengths(self.route)

    @cached_property
    def _left(self) -> Array:
        """Unit normals to the left, (N, 2): the mean of the edges before and after."""
        edge = np.diff(self.route, axis=0)
        edge = edge + np.roll(edge, 1, axis=0)
        normal = np.column_stack([-edge[:, 1], edge[:, 0]])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.vstack([normal, normal[:1]])

    @property
    def length_m(self) -> float:
        """Length of the whole route."""
        return float(self.marks_m[-1])

    def at(self, along_left: Array) -> Array:
        """Map (..., 2) distance along and offset to the left, metres, to (..., 2) x, y."""
        s = np.asarray(along_left)[..., 0] % self.length_m
        middle, left = (
            np.stack([np.interp(s, self.marks_m, values[:, k]) for k in (0, 1)], axis=-1)
            for values in (self.route, self._left)
        )
        return middle + np.asarray(along_left)[..., 1:] * left

    def yaw(self, along_m: float) -> float:
        """Return the heading of the route, radians."""
        left = [np.interp(along_m % self.length_m, self.marks_m, self._left[:, k]) for k in (0, 1)]
        return float(np.arctan2(-left[0], left[1]))

    def bent(self, mesh: Mesh) -> Mesh:
        """Lay a mesh, whose x is the distance along and y the offset to the left, on the route."""
        points = np.column_stack([self.at(mesh.points[:, :2]), mesh.points[:, 2]])
        return replace(mesh, points=points)
