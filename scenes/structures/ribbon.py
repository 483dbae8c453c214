"""Coordinates along a route: distance along it and offset to the left."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scenes.geometry.mesh import Mesh
from scenes.geometry.routes import arc_lengths
from vo.contract.arrays import Array


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
