"""Light of lamps inside the scene: pools on the ground, shadows behind boxes."""

from dataclasses import dataclass, replace

import numpy as np

from scenes.geometry.mesh import Mesh
from scenes.lighting.baked_light import Light, solved_normals
from scenes.lighting.shadow import Occluder, Table, crossing, occluder_table, occlusion
from vo.contract.arrays import Array
from vo.contract.compilation import compiled

BULB_M = 0.12
"""Radius of a lamp's shade: softens shadows."""


@dataclass(frozen=True)
class Lamplight:
    """Lamps that shine downwards and sideways, and the boxes that occlude them.

    Attributes:
        places: (L, 3) metres, world.
        powers: (L,) share of the key light on a surface that faces the lamp at 1 m.
        light: Gives the lamps' colour as its key and the rest of the sky as its fill.
    """

    places: Array
    powers: Array
    occluders: list[Occluder]
    light: Light

    def bake(self, mesh: Mesh) -> Mesh:
        """Bake the lamps into a mesh's shading normals."""
        clear = np.ascontiguousarray(mesh.points + 3e-3 * mesh.normals)
        turn = np.arange(4) * np.pi / 2
        ring = BULB_M * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        normals, places, powers = (
            np.ascontiguousarray(a, dtype=float) for a in (mesh.normals, self.places, self.powers)
        )
        key = _received(clear, normals, places, powers, ring, occluder_table(self.occluders))
        soft = 1 - np.exp(-key)  # pools keep their texture right below a lamp
        sky = occlusion(clear, self.occluders) * (0.55 + 0.45 * mesh.normals[:, 2])
        return replace(mesh, normals=solved_normals(soft, sky, self.light))


@compiled()
def _received(
    points: Array, normals: Array, places: Array, powers: Array, ring: Array, table: Table
) -> Array:
    """Compute the irradiance (V,) from all lamps; each ray ends at the lamp."""
    centres, halves, turns, opacities = table
    total = np.zeros(len(points))
    for n in range(len(points)):
        for m in range(len(places)):
            way = places[m] - points[n]
            squared = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
            distance = np.sqrt(squared)
            facing = (way * normals[n]).sum() / distance
            down = 0.25 + 0.75 * max(way[2], 0.0) / distance
            full = powers[m] * facing * down / max(squared, 0.04)
            if full < 0.003:
                continue
            for r in range(len(ring)):
                ray = way + ring[r]
                left = 1.0
                for b in range(len(centres)):
                    enter, leave = crossing(points[n], ray, centres[b], halves[b], turns[b])
                    if leave > enter and enter > -1e-3 and enter < 0.97:
                        left *= 1 - opacities[b]
                total[n] += full * left / len(ring)
    return total
