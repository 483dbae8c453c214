"""A meadow in summer: a mown path winds through tall grass, flowers, bushes and far trees."""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial import KDTree

from scenes.geometry.mesh import Mesh, merged, polygons
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import sun
from scenes.objects.plants import flowers, grass, tree
from scenes.objects.props import bench, bush
from scenes.pen import one_object
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import Ground, bake_ground, level, quads, scattered
from scenes.surfaces import greenery, sky, timber
from scenes.surfaces.noise import fractal
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Dense vegetation that occludes itself: fine texture near, few features far, a wide sky."
TAGS = "outdoor level vegetation far"
FIELD_M = (26.0, 22.0)
"""Size of the part with blades of grass; lawn and trees lie beyond it."""
FAR_M = 35.0
TILE_M = 0.5
PALETTE = np.array(
    [(232, 226, 208), (214, 186, 70), (132, 96, 150), (196, 78, 62), (222, 206, 120)], np.uint8
)


class Options(Settings):
    """Options of the meadow."""

    path_m: Annotated[float, Field(ge=1.0, le=3.0)] = 1.3
    """Width of the mown path, m."""
    grass_m: Annotated[float, Field(ge=0.08, le=0.6)] = 0.26
    """Mean height of the tall grass, m."""
    density: Annotated[float, Field(ge=0.1, le=2.0)] = 1.0
    """Number of blades relative to the default."""


class _Land:
    """The terrain: level on and near the path, gentle swells beyond."""

    def __init__(self, rng: np.random.Generator, route: Array, path_m: float) -> None:
        self._tree = KDTree(route)
        self._path_m = path_m
        self._waves = rng.normal(0, 0.22, (5, 2))
        self._phase = rng.uniform(0, 2 * np.pi, 5)

    def beside(self, xy: Array) -> Array:
        """Measure the distance in metres of (..., 2) points from the path, negative on it."""
        return self._tree.query(xy)[0] - self._path_m / 2

    def place(self, xy: Array) -> Array:
        """Lift (..., 2) points onto the ground: (..., 3)."""
        rise = np.clip(self.beside(xy) - 1.0, 0, 9) ** 1.5 / 27
        swell = 0.5 + 0.5 * np.sin(xy @ self._waves.T + self._phase).mean(axis=-1)
        return np.concatenate([xy, (0.9 * rise * swell)[..., None]], axis=-1)


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the meadow; layout, textures and light follow the generator."""
    stage = Stage("meadow")
    route = _route(rng)
    land = _Land(rng, route, settings.path_m)
    light = sun(rng, (34, 52))
    _define_materials(stage, rng)
    _plant(stage, rng, land)
    half = np.array(FIELD_M) / 2
    ground = bake_ground(stage, light, half, (rng, 0.22), 0.1)
    with stage.object("path", Kind.GROUND):
        _turf(ground, rng, land, half)
    with stage.object("grass"):
        _tall_grass(ground, rng, land, half, settings)
    with stage.object("flowers"):
        _flowers(ground, rng, land, half)
    return stage.scene(
        TESTS, TAGS, light, sky.town_sky(rng, houses=0.08), route=route, reach_m=half - 2
    )


def _route(rng: np.random.Generator) -> Array:
    """Go around the middle on a circle whose radius varies."""
    turns = np.linspace(0, 2 * np.pi, 11)[:-1]
    radius = np.array([5.9, 5.1, 6.0, 4.7, 5.8, 6.1, 5.0, 5.9, 4.6, 5.6]) + rng.normal(0, 0.2, 10)
    squash = np.array([1.25, 0.95])
    corners = radius[:, None] * squash * np.column_stack([np.cos(turns), np.sin(turns)])
    return rounded_loop(corners, radius_m=1.1)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("mown", greenery.mown(rng, 2048))
    stage.material("turf", greenery.lawn(rng, 1024, patchy=0.5))
    tone = 0.56 + 0.16 * fractal(rng, (512, 512), (30, 512), 0.8)  # grass, fresh to dry
    streak = 0.10 * fractal(rng, (512, 512), (3, 60), 0.3, stretch=0.15)
    stage.material("blades", greenery.grass_tones(tone + streak))
    stage.material("foliage", greenery.foliage(rng, 512, 0.12))
    stage.material("woods", greenery.foliage(rng, 512, 0.3))
    stage.material("leaves", greenery.foliage(rng, 512, 0.0))
    stage.material("bark", timber.wood(rng, (256, 512), (104, 88, 70)))
    stage.material("timber", timber.wood(rng, (256, 1024), (150, 120, 86)))
    stage.material("iron", timber.painted(rng, (256, 256), (58, 62, 60)))
    stage.material("petals", np.repeat(np.repeat(PALETTE[None], 16, axis=0), 16, axis=1))


def _plant(stage: Stage, rng: np.random.Generator, land: _Land) -> None:
    """Put bushes along the path, trees around the field and a bench beside the path."""
    _woods(stage, "woods", rng)
    for k in range(24):
        at = rng.uniform(-0.5, 0.5, 2) * FIELD_M
        radius = rng.uniform(0.22, 0.6)
        gap = float(land.beside(at))
        if gap > radius + 0.45:
            bush(stage, f"bush_{k}", rng, land.place(at), radius)
    angles = np.linspace(0, 2 * np.pi, 25)[:-1] + rng.normal(0, 0.08, 24)
    for k, angle in enumerate(angles):
        out = rng.uniform(13, 26) if k % 3 else rng.uniform(11, 14)
        at = out * np.array([1.15 * np.cos(angle), 0.95 * np.sin(angle)])
        tree(stage, f"tree_{k}", rng, land.place(at), rng.uniform(3.5, 8))
    while True:
        at = rng.uniform(-0.3, 0.3, 2) * FIELD_M
        if 0.9 < land.beside(at) < 1.3:
            break
    bench(stage, "bench", (at[0], at[1], rng.uniform(0, 2 * np.pi)), rng)


def _turf(ground: Ground, rng: np.random.Generator, land: _Land, half: Array) -> None:
    """Lay turf: 1 mm a texel on and beside the path, coarser in the field, coarsest beyond."""
    coarse = quads(-half, half, TILE_M)
    far = coarse[land.beside(coarse.mean(axis=1)) >= 1.0]
    fine = quads(-half, half, TILE_M / 2)
    in_tile = (np.floor(fine.mean(axis=1) / TILE_M) + 0.5) * TILE_M
    near = fine[land.beside(in_tile) < 1.0]
    path = level(near, scattered(rng, near, TILE_M, 2.0), land.place)
    rough = level(far, far / 3.1, land.place)
    ground.draw("mown", path, share=1 - 0.3 * (land.beside(path.points[:, :2]) > 0.1))
    ground.draw("turf", rough, share=0.75)
    outside = quads((-FAR_M, -FAR_M), (FAR_M, FAR_M), 2.0)
    outside = outside[(np.abs(outside.mean(axis=1)) > half - 2).any(axis=1)]
    ground.stage.draw("turf", level(outside, outside / 3.1, land.place).moved((0, 0, -0.05)))


@one_object
def _woods(stage: Stage, name: str, rng: np.random.Generator) -> None:
    """Close the view with the edge of a wood: a ring of foliage with a ragged top."""
    count = 600
    angle = np.linspace(0, 2 * np.pi, count + 1)
    middle, radius = rng.uniform(0, 2 * np.pi, (130, 1)), rng.uniform(1.2, 2.6, (130, 1))
    off = FAR_M * np.abs((angle - middle + np.pi) % (2 * np.pi) - np.pi)
    crowns = rng.uniform(1.0, 3.4, (130, 1)) + np.sqrt(np.maximum(radius**2 - off**2, 0))
    top = np.where(off < radius, crowns, 1.4).max(axis=0) + rng.uniform(-0.1, 0.1, count + 1)
    top[-1] = top[0]
    ring = FAR_M * np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = (np.column_stack([ring, z]) for z in (np.zeros(count + 1), top))
    corners = np.stack([low[1:], low[:-1], high[:-1], high[1:]], axis=1)
    along, up = -angle * FAR_M / 5.0, -top / 5.0
    zero = np.zeros(count)
    rim = ((along[1:], zero), (along[:-1], zero), (along[:-1], up[:-1]), (along[1:], up[1:]))
    uv = np.stack([np.stack(corner, axis=-1) for corner in rim], axis=1)
    inward = -corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    stage.draw("woods", polygons(corners, uv, inward))


def _scatter(
    rng: np.random.Generator, land: _Land, half: Array, count: int, band_m: tuple[float, float]
) -> Array:
    """Draw about `count` feet (N, 3) for each 100 m² in a band of distances from the path."""
    area = 4 * half[0] * half[1]
    xy = rng.uniform(-half, half, (int(count * area / 100), 2))
    gap = land.beside(xy)
    return land.place(xy[(gap > band_m[0]) & (gap < band_m[1])])


def _tall_grass(
    ground: Ground, rng: np.random.Generator, land: _Land, half: Array, settings: Options
) -> None:
    """Grow blades: short on the path's rim, dense and fine beside it, broad and sparse far off."""
    swath: list[Mesh] = []
    bands = (  # from, to, blades in 100 m², share of the height, width in metres
        (-0.3, 0.05, 9000, 0.2, 0.0035),
        (0.0, 0.5, 38000, 0.75, 0.005),
        (0.4, 1.4, 13000, 1.0, 0.009),
        (1.4, 4.0, 5000, 1.1, 0.018),
        (4.0, 12.0, 1600, 1.2, 0.035),
    )
    waves = rng.normal(0, 2.6, (6, 2))
    for start, end, count, share, width in bands:
        feet = _scatter(rng, land, half, int(count * settings.density), (start, end))
        lush = 1 + 0.3 * np.sin(feet[:, :2] @ waves.T).mean(axis=1) * 2
        high = settings.grass_m * share * lush * rng.uniform(0.5, 1.25, len(feet))
        swath.append(grass(rng, feet, high, width * rng.uniform(0.7, 1.3, len(feet))))
    ground.draw("blades", merged(swath))


def _flowers(ground: Ground, rng: np.random.Generator, land: _Land, half: Array) -> None:
    """Grow flowers in drifts of one or two colours."""
    uv = np.column_stack([(np.arange(len(PALETTE)) + 0.5) / len(PALETTE), np.full(5, 0.5)])
    for _ in range(40):
        xy = rng.uniform(-half, half) + rng.normal(0, 0.7, (60, 2))
        feet = land.place(xy[land.beside(xy) > 0.08])
        if not len(feet):
            continue
        high = rng.uniform(0.2, 0.45, len(feet))
        colours = uv[rng.integers(len(uv), size=2)]
        stems, heads = flowers(rng, feet, high, rng.uniform(0.014, 0.026), colours)
        ground.draw("blades", stems)
        ground.draw("petals", heads)
