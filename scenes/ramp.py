"""A paved way over a low rise: up a gentle slope, across a plateau and down again."""

import itertools
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import Mesh, merged, tube
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import sun
from scenes.objects.plants import hedge, tree
from scenes.objects.props import bench, grass_tufts, lamp_post, litter, planter, shrub
from scenes.pen import one_object
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import Ground, bake_ground, level, quads, tiled
from scenes.structures.slope import Slope
from scenes.structures.surround import kerb
from scenes.surfaces import floor, greenery, masonry, sky, timber
from scenes.surfaces.noise import smoothstep
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "A gentle slope up and down: the camera pitches with the ground and changes its height."
TAGS = "outdoor sloped textured"
HALF_WIDTH_M = 2.2
APRON_M = 3.6
"""Length of the level part at either end, where the rover turns."""
LANE_M = 1.1
SLAB_M = 0.4
KERB_M = (0.12, 0.06)
"""Width of the kerb and its height above the way."""
RAIL_HEIGHT_M = 0.95
BANK_M = 1.8
"""Width of the grassy bank on either side."""
RAIL_Y_M = HALF_WIDTH_M - 0.08


class Options(Settings):
    """Options of the rise."""

    grade_percent: Annotated[float, Field(ge=1, le=12)] = 7.0
    """Grade of the slopes, %."""
    run_m: Annotated[float, Field(ge=3, le=10)] = 5.2
    """Length of each slope, m."""
    plateau_m: Annotated[float, Field(ge=1, le=6)] = 2.8
    """Length of the level part on top, m."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the way; slabs, plants, furniture and light follow the generator."""
    stage = Stage("ramp")
    slope = Slope.rising(settings.grade_percent / 100, settings.plateau_m, settings.run_m)
    half = np.array([np.ceil((slope.knots[-1] + APRON_M) / SLAB_M) * SLAB_M, HALF_WIDTH_M])
    light = sun(rng, (34, 52))
    _define_materials(stage, rng)
    _furnish(stage, rng, slope, half)
    _surround(stage, rng, half)
    for side, name in ((-1, "rail_right"), (1, "rail_left")):
        _rail(stage, name, slope, side * RAIL_Y_M)
    reach = (half[0] + 3, half[1] + 4)
    ground = bake_ground(stage, light, reach, (rng, 0.14), elevation=slope.elevation)
    _lay_slabs(ground, rng, slope, half)
    _lay_lawn(ground, rng, slope, half)
    slope.add_collision(stage, HALF_WIDTH_M + KERB_M[0])
    reach = (half[0] + 1.0, half[1] + 2.4)
    scene = stage.scene(TESTS, TAGS, light, sky.town_sky(rng), route=_route(half), reach_m=reach)
    return replace(scene, elevation=slope.elevation)


def _route(half: Array) -> Array:
    """Drive over the rise in one lane and back in the other; start on the level, heading up."""
    x, y = half[0] - 1.1, LANE_M
    loop = rounded_loop(np.array([(x, -y), (x, y), (-x, y), (-x, -y)]), radius_m=LANE_M - 0.02)
    start = int(np.argmin(np.linalg.norm(loop - (-half[0] + APRON_M - 1.0, -y), axis=1)))
    return np.concatenate([loop[start:-1], loop[: start + 1]])


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("concrete", masonry.concrete(rng, (1024, 1024)))
    stage.material("lawn", greenery.lawn(rng, 2048))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("foliage", greenery.leaves(rng, 1, 512)[0])
    stage.material("soil", greenery.soil(rng, 512))
    stage.material("bark", timber.wood(rng, (256, 256), (96, 82, 68)))
    stage.material("timber", timber.wood(rng, (256, 1024), (142, 108, 74)))
    stage.material("iron", timber.painted(rng, (256, 256), (74, 80, 82)))


def _furnish(stage: Stage, rng: np.random.Generator, slope: Slope, half: Array) -> None:
    """Put a planter on the plateau, benches and lamps beside the level ends."""
    size = (1.4, 0.6, 0.42 + slope.top_m)
    planter(stage, "planter", rng, np.array([rng.uniform(-0.3, 0.3), 0.0]), size)
    x, y = half
    for k, (sx, sy) in enumerate(((1, 1), (-1, -1))):
        along, turn = sx * (x - rng.uniform(1.2, 2.2)), 0.0 if sy > 0 else np.pi
        place = (along, sy * (y + 0.75), turn + rng.uniform(-0.06, 0.06))
        bench(stage, f"bench_{k}", place, rng)
    for k, (sx, sy) in enumerate(((1, -1), (-1, 1))):
        lamp_post(stage, f"lamp_{k}", np.array([sx * (x - 2.6), sy * (y + 0.45)]))


def _surround(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Plant a hedge before one end, shrubs before the other, and trees around."""
    x, y = half
    hedge(stage, "hedge", rng, (x + 1.5, -y - 2.5), (x + 1.5, y + 2.5), rng.uniform(0.9, 1.2))
    with stage.object("shrubs"):
        for across in np.arange(-y - 2, y + 2.1, 0.8):
            radius = rng.uniform(0.28, 0.45)
            spot = (-x - 1.3 + rng.normal(0, 0.12), across + rng.normal(0, 0.1), 0.75 * radius)
            shrub(stage, rng, spot, radius)
    for k in range(11):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 11
        far = rng.uniform(5.5, 10.0)
        spot = ((x + far) * np.cos(angle), (y + far) * np.sin(angle), 0.0)
        tree(stage, f"tree_{k}", rng, spot, rng.uniform(4.0, 7.0))


@one_object
def _rail(stage: Stage, name: str, slope: Slope, y: float) -> None:
    """Fence one side of the slope: posts, a handrail and a knee rail."""
    x = np.linspace(slope.knots[0], slope.knots[-1], 2 * round(slope.knots[-1] / 1.3) + 1)
    feet = np.column_stack([x, np.full(len(x), y), slope.height(x)])
    rise = np.array([0, 0, RAIL_HEIGHT_M])
    for foot in feet:
        stage.draw("iron", tube(foot, foot + rise, 0.02, 8))
        stage.occluder(foot + rise / 2, (0.04, 0.04, RAIL_HEIGHT_M))
    for up in (0.53 * rise, rise):
        for a, b in itertools.pairwise(feet):
            stage.draw("iron", tube(a + up, b + up, 0.022, 8))
            stage.occluder((a + b) / 2 + up, (b[0] - a[0], 0.044, 0.05))
    size = (slope.knots[-1] - slope.knots[0], 0.06, 1.0 + slope.top_m)
    stage.obstacle(name, (0, y, size[2] / 2), size, shadow=False)


def _lay_slabs(ground: Ground, rng: np.random.Generator, slope: Slope, half: Array) -> None:
    """Lay slabs on the way and kerbs along it, and scatter dry leaves."""
    stage = ground.stage
    stage.material("slabs", floor.paving_slabs(rng, 20, 400))
    under = half + 0.1  # the kerbs stand on slabs
    corners = quads(-under, under, 0.1)
    uv = tiled(rng, corners, SLAB_M, stage.atlases["slabs"])
    with stage.object("way", Kind.GROUND):
        ground.draw("slabs", slope.tilted(level(corners, uv, slope.place)))
    with stage.object("kerb"):
        ground.draw("concrete", _kerbs(rng, slope, half))
    stage.material("litter", greenery.fallen_leaves(rng, 24, 64))
    spots = rng.uniform(-half, half, (90, 2))
    spots[:, 1] = np.sign(spots[:, 1]) * half[1] * np.abs(spots[:, 1] / half[1]) ** 0.4
    places = slope.place(spots) + np.array([0, 0, 0.003])
    with stage.object("litter"):
        ground.draw("litter", litter(rng, places, stage.atlases["litter"]))


def _kerbs(rng: np.random.Generator, slope: Slope, half: Array) -> Mesh:
    """Line the way with stones about 1 m long."""
    width, height = KERB_M
    stones: list[Mesh] = []
    for side in (-1, 1):
        reach = half[0] + width
        marks = np.linspace(-reach, reach, round(2 * reach) + 1)
        for a, b in itertools.pairwise(marks):
            y = (side * (half[1] + 0.002), side * (half[1] + width - 0.002))
            top = height + rng.normal(0, 0.0015)
            stones.append(slope.beam((a + 0.003, b - 0.003), y, (-0.05, top), 1.2, rng.random()))
    ends = [
        stone
        for stone in kerb(rng, half, width, height)
        if np.abs(stone.points[:, 0]).min() > half[0] - 0.01
    ]
    return merged(stones + ends)


def _lay_lawn(ground: Ground, rng: np.random.Generator, slope: Slope, half: Array) -> None:
    """Grow grass on the banks and beyond, uncut along the kerb."""
    edge = half + KERB_M[0] - 0.04

    def place(xy: Array) -> Array:
        away = (np.abs(xy[..., 1]) - edge[1]) / BANK_M
        share = 1 - smoothstep(0.0, 1.0, away)
        return np.concatenate([xy, (0.02 + slope.elevation(xy) * share)[..., None]], axis=-1)

    near = quads(-half - 3, half + 3, 0.25)
    keep = (np.abs(near.mean(axis=1)) > edge - 0.125).any(axis=1)
    with ground.stage.object("lawn", Kind.GROUND):
        grown = _clamped(near[keep], edge)
        ground.draw("lawn", level(grown, grown / 4.0, place))
        far = quads((-36, -36), (36, 36), 1.5)
        rim = (np.abs(far.mean(axis=1)) > half + 3).any(axis=1)
        outer = _clamped(far[rim], half + 3)
        ground.draw("lawn", level(outer, outer / 4.0, place))
        count = 500
        x = rng.uniform(-half[0], half[0], count)
        y = rng.choice((-1, 1), count) * (half[1] + KERB_M[0] + rng.exponential(0.25, count))
        tufts = grass_tufts(rng, np.column_stack([x, y]))
        tufts.points[:, 2] += place(tufts.points[:, :2])[:, 2]
        ground.draw("lawn", tufts)


def _clamped(corners: Array, hole: Array) -> Array:
    """Pull (N, 4, 2) corners inside a hole of (2,) half sizes out to its nearest edge."""
    inside = (np.abs(corners) < hole).all(axis=-1)
    nearer = np.argmin(hole - np.abs(corners), axis=-1)
    pushed = corners.copy()
    for axis in (0, 1):
        move = inside & (nearer == axis)
        pushed[move, axis] = np.sign(corners[move, axis]) * hole[axis]
    return pushed
