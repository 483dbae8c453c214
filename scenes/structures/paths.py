"""Paths and lawns of a block: sections of paving along a route, in baked light."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from scenes.geometry.mesh import Mesh, cut_into_cells, merged, patch
from scenes.geometry.routes import Ribbon
from scenes.lighting.baked_light import Light, shaded_normals
from scenes.lighting.shadow import LightMap, occlusion, visibility
from scenes.objects.props import grass_tufts, litter
from scenes.stage import Stage
from scenes.structures.ground import coursed, level, quads, scattered, tiled
from scenes.surfaces.atlas import Atlas
from scenes.surfaces.noise import fractal, smoothstep
from vo.contract.arrays import Array

PATH_M = 2.4
EDGE_M = 0.1
LAWN_M = -0.015
"""Height of the lawn, a little below the path."""
SECTIONS = ("asphalt", "slabs", "bricks", "gravel", "asphalt", "setts", "slabs", "bricks")
CHUNK_FACES = 1200
"""Meshes of the ground are lit in pieces of this size, each by the occluders around it."""


class BlockGround:
    """Draws meshes that lie on the ground, in the light that passes the occluders.

    It reaches from `low` to `high`, (2,) metres, rounded outwards to whole ones.
    """

    def __init__(
        self, stage: Stage, rng: np.random.Generator, light: Light, low: Array, high: Array
    ) -> None:
        self.stage, self._light = stage, light
        self.low, self.high = np.floor(low), np.ceil(high)
        cells = tuple(((self.high - self.low) / 0.25).astype(int))
        clouds = 1 - 0.24 * smoothstep(-0.6, 2.0, fractal(rng, cells, (2.5, 60), 0.7))
        self._dirt = LightMap(self.low, 0.25, np.stack([clouds, clouds]))

    def draw(self, material: str, mesh: Mesh) -> None:
        """Show a mesh in pieces, darkened in clouds by dirt and damp."""
        for cell in cut_into_cells(mesh, CHUNK_FACES):
            dirt, _ = self._dirt.at(cell.points)
            clear = cell.points + np.array([0, 0, 0.02])
            key = visibility(clear, self.stage.occluders, self._light, 4, inside=True)
            fill = occlusion(clear, self.stage.occluders, inside=True)
            normals = shaded_normals(cell.normals, key * dirt, fill * dirt, self._light)
            self.stage.draw(material, replace(cell, normals=normals), lit=True)


def pave(ground: BlockGround, rng: np.random.Generator, ribbon: Ribbon) -> None:
    """Lay the sections of the path, its edging, covers and fallen leaves."""
    ends = np.linspace(0, ribbon.length_m, len(SECTIONS) + 1)
    turn = int(rng.integers(len(SECTIONS)))
    for k, (start, end) in enumerate(pairwise(ends)):
        kind = SECTIONS[(k + turn) % len(SECTIONS)]
        atlas = ground.stage.atlases.get(kind)
        ground.draw(kind, ribbon.bent(_section(rng, kind, start, end, atlas)))
        if kind != "gravel":
            spots = np.arange(start + 6, end - 4, 13.0) + rng.uniform(-2, 2)
            covers = [
                patch((s, t, 0.0006), (0.5, 0, 0), (0, 0.5, 0), (2, 2))
                for s, t in zip(spots, rng.uniform(-1.0, 0.5, len(spots)), strict=True)
            ]
            ground.draw("cover", ribbon.bent(merged(covers)))
    for side in (-1, 1):
        low = side * (PATH_M + EDGE_M) / 2 - EDGE_M / 2
        strip = quads((0.0, low), (ribbon.length_m, low + EDGE_M), 0.5)
        edge = level(strip, scattered(rng, strip, 1.0, 1.2))
        first, run = (ribbon.length_m, -ribbon.length_m) if side < 0 else (0, ribbon.length_m)
        foot = (first, low if side < 0 else low + EDGE_M, -0.03)
        skirt = patch(foot, (run, 0, 0), (0, 0, 0.03), (600, 1), (1.2, 1.2))
        ground.draw("concrete", ribbon.bent(merged([edge, skirt])))
    along, side = rng.uniform(0, ribbon.length_m, 900), rng.choice([-1, 1], 900)
    where = np.column_stack([along, side * rng.beta(4, 2, 900) * 1.2])
    fallen = np.column_stack([ribbon.at(where), np.full(900, 0.003)])
    ground.draw("litter", litter(rng, fallen, ground.stage.atlases["litter"]))


def _section(
    rng: np.random.Generator, kind: str, start: float, end: float, atlas: Atlas | None
) -> Mesh:
    """Lay one section in the ribbon's own coordinates."""
    half = np.array([(end - start) / 2, PATH_M / 2])
    if atlas is not None and kind != "slabs":
        rows, lengths = (24, (0.196, 0.206)) if kind == "bricks" else (20, (0.1, 0.15))
        laid = coursed(rng, half, PATH_M / rows, lengths, atlas)
        return laid.moved(((start + end) / 2, 0.0, 0.0))
    if atlas is not None:
        rows = round((end - start) / 0.4)
        scale = np.array([(end - start) / (0.4 * rows), 1.0])
        corners = quads((0.0, -PATH_M / 2), (0.4 * rows, PATH_M / 2), 0.2)
        return level(corners * scale + np.array([start, 0.0]), tiled(rng, corners, 0.4, atlas))
    corners = quads((0.0, -1.5), (np.floor((end - start) * 4) / 4, 1.5), 0.25)
    uv = scattered(rng, corners, 0.5, 1.024)
    squeeze = np.array([(end - start) / (np.floor((end - start) * 4) / 4), PATH_M / 3.0])
    return level(corners * squeeze + np.array([start, 0.0]), uv)


def lawn(ground: BlockGround, rng: np.random.Generator, ribbon: Ribbon) -> None:
    """Sow lawn everywhere, uncut where the mower meets the path."""
    corners = quads(tuple(ground.low), tuple(ground.high), 1.0)
    distance = KDTree(ribbon.route).query(corners.mean(axis=1))[0]
    corners = corners[distance > PATH_M / 2 - 0.75]
    ground.draw("lawn", level(corners, scattered(rng, corners, 1.0, 2.05), LAWN_M))
    count = 1500
    beside = PATH_M / 2 + EDGE_M + 0.02 + rng.exponential(0.15, count)
    along = rng.uniform(0, ribbon.length_m, count)
    places = np.column_stack([along, beside * rng.choice([-1, 1], count)])
    ground.draw("lawn", grass_tufts(rng, ribbon.at(places), 7))
