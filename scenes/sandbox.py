"""A pit of loose sand in low sun: ripples, stones, and the tracks of the rover's own wheels."""

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial import KDTree

from scenes.geometry.mesh import box
from scenes.geometry.routes import Ribbon, rounded_loop
from scenes.lighting.baked_light import Light, lamp
from scenes.objects.plants import hedge, tree
from scenes.objects.props import bench
from scenes.objects.stones import pebbles, shovel, stone
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import Ground, bake_ground, level, quads
from scenes.structures.wheel_tracks import TEXEL_M, Sand, track_mesh, track_texture
from scenes.surfaces import greenery, masonry, sand, sky, timber
from scenes.surfaces.noise import fractal, smoothstep, to_image
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Loose sand with little texture in low sun: wheel tracks, ripples, stones, long shadows."
TAGS = "outdoor level"
HALF_M: Array = np.array([7.0, 5.0])
"""Half sizes of the pit."""
TILE_PX = 1536
SUNK_M = 0.0006
"""Depth of the sand beside the strip of tracks, which lies on top of it."""
BOARD_M = (0.05, 0.24)
"""Thickness and height of the boards around the pit."""
LAWN_M = -0.04
WALL_M = (2.2, 4.0)
"""Distance from the pit and height of the walls of the hall."""
CEILING = np.full((6 * 16, 16, 3), 16, dtype=np.uint8)
"""Six faces of a cube: the hall is dark above the lamp."""


class Options(Settings):
    """Options of the sandbox."""

    sun_deg: Annotated[float, Field(ge=10, le=60)] = 18.0
    """Elevation of the sun, degrees."""
    stones: Annotated[int, Field(ge=0, le=80)] = 48
    """Number of places at which stones may lie."""
    mounds_m: Annotated[float, Field(ge=0, le=0.15)] = 0.06
    """Height of the mounds away from the route, m."""
    surround: Literal["garden", "hall"] = "garden"
    """Around the pit: lawn, hedge and trees, or a dark hall with boards, as of a laboratory."""


class _Land:
    """The surface of the sand: level on and near the route, low mounds beyond."""

    def __init__(self, rng: np.random.Generator, route: Array, mounds_m: float) -> None:
        self._tree = KDTree(route)
        self._waves = rng.normal(0, 2.4, (7, 2))
        self._phase = rng.uniform(0, 2 * np.pi, 7)
        self._mounds_m = mounds_m

    def beside(self, xy: Array) -> Array:
        """Measure the distance in metres of (..., 2) points from the route."""
        return self._tree.query(xy)[0]

    def place(self, xy: Array) -> Array:
        """Lift (..., 2) points onto the sand: (..., 3)."""
        swell = smoothstep(-0.25, 0.9, np.sin(xy @ self._waves.T + self._phase).mean(axis=-1))
        height = self._mounds_m * 2 * swell * smoothstep(0.5, 1.3, self.beside(xy)) - SUNK_M
        return np.concatenate([xy, height[..., None]], axis=-1)

    def normals(self, xy: Array, step_m: float = 0.02) -> Array:
        """Return the unit normals (N, 3) of the surface at (N, 2) points."""
        along, across = (
            self.place(xy + step) - self.place(xy - step) for step in step_m * np.eye(2)
        )
        normals = np.cross(along, across)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the sandbox; layout, relief, tracks and light follow the generator."""
    stage = Stage("sandbox")
    light = lamp(
        (rng.uniform(0, 2 * np.pi), settings.sun_deg),
        on_ground=(0.44, 0.40, 0.33),
        fill=(0.25, 0.265, 0.30),
        ambient=(0.20, 0.205, 0.22),
    )
    route = _route(rng)
    ribbon, land = Ribbon(route), _Land(rng, route, settings.mounds_m)
    tile = (TILE_PX, TILE_PX)
    loose = Sand(sand.relief(rng, tile, TEXEL_M), sand.grains(rng, tile))
    stage.material("tracks", track_texture(rng, ribbon, loose, light))
    stage.material("sand", loose.texture(light))
    _define_materials(stage, rng)
    _furnish(stage, rng, land, settings.stones)
    indoors = settings.surround == "hall"
    if indoors:
        _wall_in(stage, rng)
    else:
        _plant(stage, rng, light)
    ground = bake_ground(stage, light, HALF_M + 4, (rng, 0.10), 0.05)
    with stage.object("tracks", Kind.GROUND):
        ground.draw("tracks", track_mesh(ribbon))
    with stage.object("sand", Kind.GROUND):
        _lay_sand(ground, land)
    outer = "walls" if indoors else "lawn"
    with stage.object(outer, Kind.GROUND):
        corners = quads((-36, -36), (36, 36), 1.0)
        outside = (np.abs(corners.mean(axis=1)) > HALF_M).any(axis=1)
        ground.draw(outer, level(corners[outside], corners[outside] / 4.0, LAWN_M))
    view = CEILING if indoors else sky.town_sky(rng, houses=0.2)
    return stage.scene(TESTS, TAGS, light, view, route=route, reach_m=HALF_M)


def _route(rng: np.random.Generator) -> Array:
    """Drive around in the pit, counter-clockwise."""
    x, y = 5.3, 3.3
    corners = np.array([(x, -y), (x, y), (0.3, y), (-x, y), (-x, -y), (-0.3, -y)])
    return rounded_loop(corners + rng.uniform(-0.3, 0.3, corners.shape), radius_m=1.2)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    tint = masonry.concrete(rng, (512, 512), 112.0) * np.array([1.02, 0.95, 0.88])
    veins = 1 + 0.10 * fractal(rng, (512, 512), (6, 80), 0.8, stretch=3.0)
    stage.material("rock", to_image(tint * veins[..., None]))
    stage.material("timber", timber.wood(rng, (256, 1024), (136, 110, 82)))
    stage.material("plastic", timber.painted(rng, (256, 256), (74, 92, 116)))
    stage.material("lawn", greenery.lawn(rng, 1024))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("foliage", greenery.leaves(rng, 1, 512)[0])
    stage.material("bark", timber.wood(rng, (256, 256), (96, 82, 68)))
    stage.material("iron", timber.painted(rng, (256, 256), (92, 96, 96)))


def _furnish(stage: Stage, rng: np.random.Generator, land: _Land, stones: int) -> None:
    """Edge the pit with boards, and put stones, pebbles and a shovel into it."""
    thick, high = BOARD_M
    for k, (axis, sign) in enumerate(((0, -1), (0, 1), (1, -1), (1, 1))):
        centre, size = np.array([0.0, 0.0, high / 2 - 0.05]), np.array([thick, thick, high])
        centre[axis] = sign * (HALF_M[axis] + thick / 2)
        size[1 - axis] = 2 * HALF_M[1 - axis] + 2 * thick * (axis == 0)
        with stage.object(f"board_{k}"):
            stage.draw("timber", box(centre, size, (2.0, 0.25), rng.random(2)))
        stage.obstacle(f"board_{k}", centre, size)
    for k in range(stones):
        radius = rng.choice((0.08, 0.11, 0.15, 0.21), p=(0.35, 0.3, 0.2, 0.15))
        at = rng.uniform(-1, 1, 2) * (HALF_M - 0.5)
        if land.beside(at) > 1.2 * radius + 0.40:
            stone(stage, f"stone_{k}", rng, land.place(at), radius)
    shovel(stage, "shovel", (rng.uniform(-1.5, 1.5), rng.uniform(-0.8, 0.8), rng.uniform(0, 6.28)))
    small = rng.uniform(-1, 1, (1000, 2)) * (HALF_M - 0.1)
    small = small[land.beside(small) > 0.25]
    with stage.object("pebbles"):
        stage.draw("rock", pebbles(rng, land.place(small), (0.005, 0.018)))


def _plant(stage: Stage, rng: np.random.Generator, light: Light) -> None:
    """Put a bench, a hedge and trees around the pit, but where they would shade all of it."""
    bench(stage, "bench", (rng.uniform(-3, 3), HALF_M[1] + 1.2, rng.normal(0, 0.1)), rng)
    x, y = HALF_M + 2.6
    hedge(stage, "hedge", rng, (-x, y), (x, y), rng.uniform(1.0, 1.4))
    for k in range(9):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 9
        towards = np.array([np.cos(angle), np.sin(angle)])
        if towards @ light.key[:2] > 0.5:
            continue
        out = (HALF_M + rng.uniform(6.5, 12.0)) * (1.2, 1.3) * towards
        tree(stage, f"tree_{k}", rng, (*out, LAWN_M), rng.uniform(4.0, 7.0))


def _wall_in(stage: Stage, rng: np.random.Generator) -> None:
    """Stand dark walls around the pit, with boards that lean against them, and shelves.

    The lamp is inside: walls cast no shadow.
    """
    stage.material("walls", timber.painted(rng, (256, 256), (22, 22, 24)))
    stage.material("boards", timber.wood(rng, (256, 1024), (176, 148, 112)))
    away, high = WALL_M
    reach = HALF_M + away
    for k, (axis, sign) in enumerate(((0, -1), (0, 1), (1, -1), (1, 1))):
        centre, size = np.array([0.0, 0.0, high / 2 - 0.1]), np.array([0.1, 0.1, high])
        centre[axis], size[1 - axis] = sign * reach[axis], 2 * reach[1 - axis]
        with stage.object(f"wall_{k}"):
            stage.draw("walls", box(centre, size, (2.0, 2.0), rng.random(2)))
        stage.obstacle(f"wall_{k}", centre, size, shadow=False)
        along = -reach[1 - axis] + rng.uniform(0.5, 2.0)
        while along < reach[1 - axis] - 1.6:
            wide, tall = rng.uniform(0.5, 1.4), rng.uniform(0.8, 2.2)
            centre, size = np.array([0.0, 0.0, tall / 2 + LAWN_M]), np.array([0.04, 0.04, tall])
            centre[axis] = sign * (reach[axis] - rng.uniform(0.1, 0.6))
            centre[1 - axis], size[1 - axis] = along + wide / 2, wide
            name, kind = f"board_{k}_{along:.1f}", str(rng.choice(["boards", "timber", "iron"]))
            with stage.object(name):
                stage.draw(kind, box(centre, size, (1.2, 0.6), rng.random(2)))
            stage.obstacle(name, centre, size, shadow=False)
            along += wide + rng.uniform(0.3, 3.0)


def _lay_sand(ground: Ground, land: _Land) -> None:
    """Lay the sand, shaded by its mounds."""
    corners = quads(-HALF_M, HALF_M, 0.1)
    mesh = level(corners, corners / (TILE_PX * TEXEL_M), land.place)
    ground.draw("sand", replace(mesh, normals=land.normals(mesh.points[:, :2])))
