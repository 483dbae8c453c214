"""Ground: quads and courses of blocks without repetition, in the ground's own baked light."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, patch, polygons
from scenes.lighting.baked_light import Light, shaded_normals
from scenes.lighting.shadow import LightMap, ground_light
from scenes.stage import Stage, extent
from scenes.surfaces.atlas import Atlas
from scenes.surfaces.noise import fractal, smoothstep
from vo.contract.arrays import Array

Placing = Callable[[Array], Array]
"""(..., 2) plan coordinates in metres to (..., 3) points in the world."""
OVERLAP_M = 2e-4
"""Overlap of neighbouring courses, which share no vertices: without it hairlines open."""
_UNIT = np.array([(0.0, 1.0), (1, 1), (1, 0), (0, 0)])


def strip(
    low: Vector, high: Vector, height_m: float, period_m: float, cell_m: float = 0.25
) -> Mesh:
    """Cover x, y from (2,) low to (2,) high; neighbours of one period join without a seam."""
    sx, sy = high[0] - low[0], high[1] - low[1]
    cells = (int(np.ceil(sx / cell_m)), int(np.ceil(sy / cell_m)))
    offset = (low[0] / period_m, -high[1] / period_m)
    return patch((*low, height_m), (sx, 0, 0), (0, sy, 0), cells, (period_m, period_m), offset)


def quads(low: Vector, high: Vector, cell_m: float) -> Array:
    """Divide a rectangle into squares of about `cell_m`: (N, 4, 2) corners, counter-clockwise."""
    a, b = (
        np.linspace(start, end, max(1, round((end - start) / cell_m)) + 1)
        for start, end in zip(low, high, strict=True)
    )
    x, y = (v.ravel() for v in np.meshgrid(a[:-1], b[:-1], indexing="ij"))
    dx, dy = a[1] - a[0], b[1] - b[0]
    square = np.array([(0, 0), (dx, 0), (dx, dy), (0, dy)])
    return np.column_stack([x, y])[:, None] + square


def scattered(rng: np.random.Generator, corners: Array, tile_m: float, period_m: float) -> Array:
    """Show tiles, squares of `tile_m`, from random places of a tiling texture, turned at random.

    A texture without features larger than a tile, of the size `period_m`, joins without visible
    seams and never repeats. The texture coordinates (N, 4, 2) are of (N, 4, 2) corners of quads,
    none of which may lie in two tiles.
    """
    share, tile = _in_tiles(rng, corners, tile_m)
    places = rng.random((tile.max() + 1, 2))
    return share * tile_m / period_m + places[tile][:, None]


def tiled(rng: np.random.Generator, corners: Array, tile_m: float, atlas: Atlas) -> Array:
    """Lay tiles of random variants in random turns; arguments and result as in `scattered`."""
    share, tile = _in_tiles(rng, corners, tile_m)
    rects = atlas.pick(rng, tile.max() + 1)[tile][:, None]
    return rects[..., :2] + share * (rects[..., 2:] - rects[..., :2])


def _in_tiles(rng: np.random.Generator, corners: Array, tile_m: float) -> tuple[Array, Array]:
    """Find the place of (N, 4, 2) corners in their tile, 0 to 1 in its turn; and the tile (N,)."""
    index = np.floor(corners.mean(axis=1) / tile_m)
    _, tile = np.unique(index, axis=0, return_inverse=True)
    turns = rng.random((tile.max() + 1, 3)) < 0.5
    share = corners / tile_m - index[:, None]
    swap, flip = turns[tile, None, :1], turns[tile, None, 1:]
    share = np.where(swap, share[..., ::-1], share)
    return np.where(flip, 1 - share, share), tile


def level(corners: Array, uv: Array, place: Placing | float = 0.0) -> Mesh:
    """Build (N, 4, 2) quads, either at a height in metres or placed in the world, facing up."""
    if callable(place):
        points = place(corners)
    else:
        points = np.concatenate([corners, np.full((*corners.shape[:-1], 1), place)], axis=-1)
    return polygons(points, uv, np.broadcast_to(np.array([0, 0, 1.0]), points.shape))


@dataclass(frozen=True)
class Ground:
    """The ground of a scene in its light, baked as the lamps' shares on it."""

    stage: Stage
    light: Light
    baked: LightMap

    def draw(self, material: str, *meshes: Mesh, share: Array | float = 1.0) -> None:
        """Show meshes that lie on the ground, in a (V,) share of its baked light."""
        for mesh in meshes:
            key, fill = self.baked.at(mesh.points)
            normals = shaded_normals(mesh.normals, key * share, fill * share, self.light)
            self.stage.draw(material, replace(mesh, normals=normals), lit=True)


def bake_ground(
    stage: Stage,
    light: Light,
    reach: Vector,
    stains: tuple[np.random.Generator, float] | None = None,
    step_m: float = 0.05,
    elevation: Callable[[Array], Array] | None = None,
) -> Ground:
    """Bake the light on the ground of a stage, once all that casts shadow stands on it.

    `reach` is (4,) x_min, y_min, x_max, y_max in metres, or (2,) half sizes about the origin.
    `stains` are generator and strength of clouds of half a metre to several that darken the
    ground: damp, dirt, worn tracks. The others are as for `ground_light`.
    """
    baked = ground_light(extent(reach), stage.occluders, light, step_m, elevation)
    if stains is not None:
        rng, strength = stains
        cloud = fractal(rng, baked.shares.shape[1:], (0.4 / step_m, 5 / step_m), 0.8)
        clear = 1 - strength * smoothstep(-0.5, 2.0, cloud)
        baked = replace(baked, shares=baked.shares * clear)
    return Ground(stage, light, baked)


def coursed(
    rng: np.random.Generator,
    half: Array,
    width_m: float,
    lengths_m: Vector,
    atlas: Atlas,
    cuts: int = 1,
) -> Mesh:
    """Cover (2,) half sizes about the origin, metres, with courses along x of a width.

    Pieces have random lengths between two, faces of the atlas with their length along u, and
    `cuts` quads each for baked light. The last course may reach beyond the half size in y.
    """
    x, y = half
    pieces: list[Array] = []
    for low, high in itertools.pairwise(np.arange(-y, y + width_m, width_m)):
        ends = _ends(rng, x, lengths_m)
        low_ = np.full(len(ends) - 1, low - OVERLAP_M)
        high_ = np.full(len(ends) - 1, high + OVERLAP_M)
        a, b = ends[:-1], ends[1:]
        pieces.append(np.stack([a, low_, b, low_, b, high_, a, high_], axis=1).reshape(-1, 4, 2))
    corners = np.concatenate(pieces)
    cell = atlas.pick(rng, len(corners))
    share = np.where(rng.random((len(corners), 1, 2)) < 0.5, 1 - _UNIT, _UNIT)
    uv = cell[:, None, :2] + share * (cell[:, 2:] - cell[:, :2])[:, None]
    return level(_cut(corners, cuts), _cut(uv, cuts))


def _ends(rng: np.random.Generator, x: float, lengths_m: Vector) -> Array:
    """Draw the ends of the pieces of one course, from -x to x; the outermost are cut off."""
    steps = rng.uniform(lengths_m[0], lengths_m[1], int(2 * x / lengths_m[0]) + 3)
    ends = -x - steps[0] * rng.uniform(0, 0.9) + np.concatenate([[0], np.cumsum(steps)])
    return np.clip(ends[: np.searchsorted(ends, x) + 1], -x, x)


def _cut(quads: Array, cuts: int) -> Array:
    """Cut (N, 4, 2) quads across their first side into (N cuts, 4, 2)."""
    share = np.linspace(0, 1, cuts + 1)[:, None]
    low = quads[:, None, 0] + share * (quads[:, None, 1] - quads[:, None, 0])
    high = quads[:, None, 3] + share * (quads[:, None, 2] - quads[:, None, 3])
    cut = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return cut.reshape(-1, 4, 2)
