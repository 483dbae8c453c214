"""Light of ceiling panels that are near enough to shine on floor and walls unevenly."""

from dataclasses import dataclass

import numpy as np

from scenes.light import Light, solved_normals
from scenes.mesh import Mesh
from vo.contract.arrays import Array

BOUNCE = 0.3
"""Of a room's full light, what reaches every surface from all the others."""


@dataclass(frozen=True)
class Panels:
    """Equal small lamps that shine down, and the block of the building that they do not pass.

    Attributes:
        places: (P, 3) metres, world.
        core: (2,) half sizes, metres, of a block about the origin; zeros where there is none.
    """

    places: Array
    core: Array

    def shine(self, mesh: Mesh, light: Light) -> Mesh:
        """Bake the panels' light into a mesh, in place of what `light` alone would give."""
        share = BOUNCE + (1 - BOUNCE) * self._direct(mesh)
        normals = solved_normals(share * light.key[2], share, light)
        return Mesh(mesh.points, normals, mesh.uv, mesh.faces)

    def _direct(self, mesh: Mesh) -> Array:
        """Light straight from the panels, about 1 below one of a close row: (V,)."""
        sum_of_all = np.zeros(len(mesh.points))
        height = float(self.places[:, 2].max())
        for place in self.places:
            way = place - mesh.points
            squared = np.maximum((way**2).sum(axis=1), 0.05)
            cosines = np.maximum(way[:, 2], 0) * np.maximum((way * mesh.normals).sum(axis=1), 0)
            open_ = ~_passes(mesh.points + 1e-3 * mesh.normals, place, self.core)
            sum_of_all += open_ * cosines * height**2 / squared**2
        return np.minimum(0.65 * sum_of_all, 1)


def _passes(points: Array, place: Array, half: Array) -> Array:
    """Whether the ways in the plane from (V, 3) points to a place cross a block: (V,) bool."""
    start, way = points[:, :2], place[:2] - points[:, :2]
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)
    a, b = (-half - start) / way, (half - start) / way
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return (enter < leave) & (leave > 0) & (enter < 1)
