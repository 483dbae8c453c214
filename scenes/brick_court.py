"""A paved court in the sun: every brick its own, settled by a few millimetres."""

from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field

from scenes.geometry.mesh import merged, patch
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import sun
from scenes.objects.props import bench, grass_tufts, lamp_post, litter, planter, potted_plant, shrub
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import Ground, bake_ground, strip
from scenes.structures.paving import BEVEL_M, Bond, Paving, brick_flanks, brick_tops, lay
from scenes.structures.surround import brick_wall, hang_posters, kerb, plaster_wall
from scenes.surfaces import greenery, masonry, prints, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Outdoor paving of single bricks: bumps shake the camera; the ground is rich in texture."
TAGS = "outdoor bumpy textured"
MODULE_M = 0.1
SWATH_M = 0.6
"""Distance from the route within which every brick is a collision box."""
FLANKS_M = 1.0
"""Distance from the route beyond which the flanks, a few millimetres high, are not drawn."""
BRICK_THICKNESS_M = 0.06


class Options(Settings):
    """Options of the court."""

    length_m: Annotated[float, Field(ge=9, le=20)] = 12.0
    """Size of the paving along x, m."""
    width_m: Annotated[float, Field(ge=7, le=16)] = 9.0
    """Size of the paving along y, m."""
    height_std_mm: Annotated[float, Field(ge=0, le=5)] = 2.0
    """Standard deviation of the bricks' heights, which are clipped at twice this, mm."""
    gap_mm: Annotated[float, Field(ge=1, le=12)] = 4.0
    """Width of the joints, mm."""
    bond: Bond = "herringbone"
    """Laying pattern: herringbone or running."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the court; layout, textures and light follow the generator."""
    stage = Stage("brick_court")
    sand_m = -(2.5 * settings.height_std_mm + 1.5) / 1e3  # below the lowest corner of a brick
    half = np.array([settings.length_m, settings.width_m]) / 2
    cells = (round(settings.length_m / MODULE_M), round(settings.width_m / MODULE_M))
    gap, deviation = settings.gap_mm / 1e3, settings.height_std_mm / 1e3
    paving = lay(rng, cells, MODULE_M, gap, deviation, settings.bond)
    route = _route(rng, half)
    gap_m = np.linalg.norm(paving.centre[:, None, :2] - route[None, ::2], axis=-1).min(axis=1)
    light = sun(rng)
    _define_materials(stage, rng)
    _furnish(stage, rng, half)
    _surround(stage, rng, half)
    ground = bake_ground(stage, light, half + 3, (rng, 0.14))
    with stage.object("paving", Kind.GROUND):
        _pave(ground, rng, paving, gap_m)
    with stage.object("surrounding_ground", Kind.GROUND):
        _edge(ground, rng, half, sand_m)
    stage.floor(sand_m)
    _add_collision(stage, paving.select(gap_m < SWATH_M))
    return stage.scene(
        TESTS, TAGS, light, sky.town_sky(rng), route=route, reach_m=half + 0.6, floor_m=None
    )


def _route(rng: np.random.Generator, half: Array) -> Array:
    """Drive around the middle, counter-clockwise, with a jog in each long side."""
    x, y = half - 0.95
    jog = rng.uniform(0.25, 0.45, 2)
    corners = np.array([
        (x, -y + rng.uniform(0, 0.2)), (x - rng.uniform(0, 0.2), y),
        (0.45 * x, y), (0.15 * x, y - jog[0]), (-0.45 * x, y - jog[0]),
        (-x, y - rng.uniform(0, 0.2)), (-x + rng.uniform(0, 0.2), -y),
        (-0.45 * x, -y), (-0.15 * x, -y + jog[1]), (0.35 * x, -y + jog[1]),
    ])  # fmt: skip
    return rounded_loop(corners, radius_m=0.9)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    """Define the materials; the bricks, which hide most of the others, are the first."""
    stage.material("paving", masonry.paving_bricks(rng, 144, (100, 200)))
    stage.material("sand", masonry.sand(rng, 1024))
    stage.material("concrete", masonry.concrete(rng, (1024, 1024)))
    stage.material("mortar", masonry.concrete(rng, (512, 512), 168.0))
    stage.material("plaster", masonry.plaster(rng, (1024, 2048), (206, 190, 160)))
    stage.material("gravel", masonry.gravel(rng, 1024))
    stage.material("lawn", greenery.lawn(rng, 2048))
    stage.material("soil", greenery.soil(rng, 512))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("timber", timber.wood(rng, (256, 1024), (142, 108, 74)))
    stage.material("pot", timber.painted(rng, (256, 256), (158, 106, 82)))
    stage.material("iron", timber.painted(rng, (256, 256), (58, 62, 60)))


def _furnish(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Put planters, benches and the lamp inside the loop of the route."""
    room = half - 2.3  # the route keeps outside this
    planter(stage, "planter_0", rng, np.array([-0.45, 0.1]) * room, (2.2, 1.0, 0.45))
    planter(stage, "planter_1", rng, np.array([0.62, 0.25]) * room, (1.2, 1.2, 0.40))
    x, y = room
    bench(stage, "bench_0", (0.1 * x, -0.55 * y, rng.uniform(-0.2, 0.2)), rng)
    bench(stage, "bench_1", (0.15 * x, 0.62 * y, np.pi + rng.uniform(-0.2, 0.2)), rng)
    for k, corner in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        beside = half + rng.uniform(0.35, 0.55, 2)
        potted_plant(stage, f"pot_{k}", rng, beside * corner)
    lamp_post(stage, "lamp", np.array([0.85, -0.6]) * room)


def _surround(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Build walls to the north and west, shrubs before them and along the open sides."""
    x, y = half
    stage.material("wall_bricks", masonry.wall_bricks(rng, 64, (48, 140)))
    brick_wall(stage, "wall_north", (-x - 1.0, y + 1.0, 0.0), rng, 2 * x + 3.6, 2.2)
    west = (-x - 1.0, -y - 2.6, np.pi / 2)
    plaster_wall(stage, "wall_west", west, rng, 2 * y + 3.6, 2.4)
    stage.material("posters", prints.posters(rng, 8, (420, 300)))
    spots = [
        (along + rng.uniform(0, 0.9), rng.uniform(0.32, 0.7), 0.6, 0.84)
        for along in np.arange(1.5, 2 * y + 2, 1.7)
    ]
    with stage.object("posters"):
        hang_posters(stage, rng, west, spots)
    with stage.object("shrubs"):
        _plant_shrubs(stage, rng, half)


def _plant_shrubs(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Plant shrubs before the walls and along the open sides."""
    x, y = half
    for _ in range(9):
        along = rng.uniform(-0.95, 0.95)
        at = (along * x, y + 0.62) if rng.random() < 0.6 else (-x - 0.62, along * y)
        radius = rng.uniform(0.2, 0.34)
        shrub(stage, rng, (*at, 0.75 * radius), radius)
    for k in range(14):
        at = (x + rng.uniform(1.6, 2.4), (k / 7 - 1) * (y + 1) + rng.uniform(-0.3, 0.3))
        shrub(stage, rng, (*at, 0.35), rng.uniform(0.35, 0.5))


def _edge(ground: Ground, rng: np.random.Generator, half: Array, sand_m: float) -> None:
    """Put sand under the bricks, a kerb, gravel before the walls and lawn elsewhere."""
    x, y = half
    bed = half + 0.2  # reaches under the kerb, whose stones leave gaps
    sand = patch((*-bed, sand_m), (2 * bed[0], 0, 0), (0, 2 * bed[1], 0), (44, 33), (1.0, 1.0))
    ground.draw("sand", sand)
    ground.draw("concrete", merged(kerb(rng, half, 0.12, 0.03)))
    edge = 0.12
    north = strip((-x - 1.05, y + edge), (x + 3, y + 1.05), 0.0, 1.5)
    west = strip((-x - 1.05, -y - 3), (-x - edge, y + edge), 0.0, 1.5)
    ground.draw("gravel", merged([north, west]))
    east = strip((x + edge, -y - edge), (x + 3, y + 1.05), 0.012, 4.0)
    south = strip((-x - edge, -y - 3), (x + 3, -y - edge), 0.012, 4.0)
    far = (
        ((x + 3, -30), (30, 30)), ((-30, -30), (x + 3, -y - 3)),
        ((-30, y + 1.05), (x + 3, 30)), ((-30, -y - 3), (-x - 1.05, y + 1.05)),
    )  # fmt: skip
    beyond = [strip(low, high, 0.012, 4.0, 1.5) for low, high in far]
    ground.draw("lawn", merged([east, south, *beyond]))
    count = 300
    beside = 0.14 + rng.exponential(0.35, (2, count))  # uncut where the mower meets the kerb
    east = np.column_stack([x + beside[0], rng.uniform(-y, y, count)])
    south = np.column_stack([rng.uniform(-x, x, count), -y - beside[1]])
    ground.draw("lawn", grass_tufts(rng, np.concatenate([east, south])))


def _pave(ground: Ground, rng: np.random.Generator, paving: Paving, gap_m: Array) -> None:
    """Draw bricks at (N,) distances from the route, finely divided under a shadow's edge."""
    stage = ground.stage
    count = len(paving.centre)
    rects = stage.atlases["paving"].pick(rng, count)
    turned = rng.random(count) < 0.5
    probe = np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]])
    probes = paving.centre[:, None, :2] + paving.reach[:, None] * probe
    key = ground.baked.at(probes.reshape(-1, 2))[0].reshape(count, -1)
    fine = np.ptp(key, axis=1) > 0.15
    near = gap_m < FLANKS_M
    for keep, divisions, inset_m in (
        (near & ~fine, (1, 1), BEVEL_M),
        (near & fine, (4, 2), BEVEL_M),
        (~near & ~fine, (1, 1), 0.0),
        (~near & fine, (4, 2), 0.0),
    ):
        if keep.any():
            tops = brick_tops(paving.select(keep), rects[keep], turned[keep], divisions, inset_m)
            ground.draw("paving", tops)
    ground.draw("paving", brick_flanks(paving.select(near), rects[near], turned[near]))
    stage.material("litter", greenery.fallen_leaves(rng, 24, 64))
    dropped = 170
    under = paving.centre[rng.integers(count, size=dropped)]
    shift = rng.uniform(-0.04, 0.04, (dropped, 2))
    places = np.column_stack([under[:, :2] + shift, under[:, 2] + 0.003])
    ground.draw("litter", litter(rng, places, stage.atlases["litter"]))


def _add_collision(stage: Stage, near: Paving) -> None:
    """Give each brick a collision box with the pose of its drawing."""
    bricks = zip(near.centre, near.reach, near.slope, strict=True)
    for k, (centre, reach, slope) in enumerate(bricks):
        tilt = np.array([1, slope[1] / 2, -slope[0] / 2, 0])  # small turn that lifts along slope
        normal = np.array([-slope[0], -slope[1], 1]) / np.sqrt(1 + slope @ slope)
        centre_m = centre - normal * BRICK_THICKNESS_M / 2
        quat, half = tilt / np.linalg.norm(tilt), (*reach, BRICK_THICKNESS_M / 2)
        box = mujoco.mjtGeom.mjGEOM_BOX
        stage.collision(f"brick_{k}", box, pos=centre_m, quat=quat, size=half)
