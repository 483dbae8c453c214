"""A small town square: straight legs between the corners of a star, fast turns on the spot."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box, merged, polygons, tube
from scenes.geometry.routes import sharp_loop
from scenes.lighting.baked_light import Light, sun
from scenes.objects.plants import hedge, tree
from scenes.objects.props import bench, lamp_post, litter, planter, potted_plant
from scenes.pen import one_object
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.facade import facade
from scenes.structures.ground import Ground, bake_ground, coursed, strip
from scenes.surfaces import floor, greenery, masonry, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Straight legs and sharp corners: fast turns on the spot blur images of long exposure."
TAGS = "outdoor level textured sharp"
HALF_M = np.array([7.0, 6.6])
COURSE_M = 0.105
"""Width of a row of setts with its joint."""
SETT_M = (0.088, 0.125)
PLASTERS = ((206, 186, 150), (196, 160, 134), (186, 190, 180), (204, 198, 188))
WOODS = ((84, 104, 92), (112, 82, 60), (88, 100, 116), (120, 56, 48))


class Options(Settings):
    """Options of the square."""

    points: Annotated[int, Field(ge=4, le=8)] = 6
    """Number of points of the star that the route follows."""
    outer_m: Annotated[float, Field(ge=4.0, le=5.4)] = 5.1
    """Distance of its points from the fountain's middle, m."""
    inner_m: Annotated[float, Field(ge=2.2, le=3.4)] = 2.6
    """Distance of the corners between the points, m."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the square; setts, houses, plants, light and the star follow the generator."""
    stage = Stage("turntable")
    light = _noon(rng)
    _define_materials(stage, rng)
    _fountain(stage, "fountain", rng)
    _houses(stage, rng)
    _furnish(stage, rng)
    x, y = HALF_M
    ground = bake_ground(stage, light, (-x - 0.3, -y - 2.0, x + 0.3, y + 0.3), (rng, 0.14))
    with stage.object("setts", Kind.GROUND):
        ground.draw("setts", coursed(rng, HALF_M, COURSE_M, SETT_M, stage.atlases["setts"]))
    with stage.object("street", Kind.GROUND):
        _street(ground)
    _scatter_leaves(ground, rng)
    town = sky.town_sky(rng)
    reach = (-x - 0.4, -y - 0.6, x + 0.4, y + 0.4)
    return stage.scene(TESTS, TAGS, light, town, route=_star(rng, settings), reach_m=reach)


def _noon(rng: np.random.Generator) -> Light:
    """Let the sun stand above the street, the open side; bright walls light up the shade."""
    light = sun(rng, (48, 62))
    x, y, z = light.key
    south = np.array([0.6 * x, -np.sqrt(0.64 * x * x + y * y), z])
    return replace(light, key=south, ambient_rgb=1.3 * light.ambient_rgb)


def _star(rng: np.random.Generator, settings: Options) -> Array:
    """Drive around a star, counter-clockwise."""
    count = 2 * settings.points
    angle = (np.arange(count) + rng.uniform(0, 2)) * 2 * np.pi / count
    radius = np.where(np.arange(count) % 2, settings.inner_m, settings.outer_m)
    radius = radius * rng.uniform(0.97, 1.0, count)
    return sharp_loop(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("setts", floor.granite_setts(rng, 120, 104))
    stage.material("asphalt", floor.asphalt(rng, 1024))
    plasters, woods = rng.permutation(len(PLASTERS))[:3], rng.permutation(len(WOODS))[:3]
    for k, (plaster, wood) in enumerate(zip(plasters, woods, strict=True)):
        stage.material(f"plaster_{k}", masonry.plaster(rng, (512, 1024), PLASTERS[plaster], 0.8))
        stage.material(f"wood_{k}", timber.painted(rng, (256, 256), WOODS[wood]))
    stage.material("concrete", masonry.concrete(rng, (1024, 1024), 158.0))
    stage.material("glass", timber.painted(rng, (128, 128), (66, 76, 86)))
    stage.material("roof", timber.painted(rng, (256, 256), (96, 70, 58)))
    stage.material("water", floor.water(rng, 256))
    stage.material("timber", timber.wood(rng, (256, 1024), (142, 108, 74)))
    stage.material("iron", timber.painted(rng, (256, 256), (58, 62, 60)))
    stage.material("pot", timber.painted(rng, (256, 256), (158, 106, 82)))
    stage.material("soil", greenery.soil(rng, 256))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("foliage", greenery.leaves(rng, 1, 512)[0])
    stage.material("bark", timber.wood(rng, (256, 256), (96, 82, 68)))


@one_object
def _fountain(stage: Stage, name: str, rng: np.random.Generator) -> None:
    """Set a round basin with a column in the middle."""
    angle = np.linspace(0, 2 * np.pi, 13) + rng.uniform(0, 0.5)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    outer, inner, high, level_m = 1.15 * ring, 0.95 * ring, 0.42, 0.33
    outside, rim = (outer, 0.0, outer, high), (outer, high, inner, high)
    for low, z0, top, z1 in (outside, rim, (inner, high, inner, level_m)):
        edge = ((low[:-1], z0), (low[1:], z0), (top[1:], z1), (top[:-1], z1))
        corners = np.stack([np.column_stack([xy, np.full(12, z)]) for xy, z in edge], axis=1)
        along = np.arange(12)[:, None] * 0.6 + np.array([0, 0.6, 0.6, 0])
        up = np.broadcast_to(np.array([0.4, 0.4, 0, 0]), along.shape)
        stage.draw("concrete", polygons(corners, np.stack([along, up], axis=-1) / 1.2))
    disc = np.column_stack([inner[:-1], np.full(12, level_m)])[None]
    stage.draw("water", polygons(disc, disc[..., :2] / 1.5))
    stage.draw("concrete", tube((0, 0, 0), (0, 0, 1.25), 0.16, 12, 0.75))
    stage.draw("concrete", box((0, 0, 0.42), (0.42, 0.42, 0.2), (1.2, 1.2), rng.random(2)))
    stage.draw("concrete", tube((0, 0, 1.25), (0, 0, 1.34), 0.12, 14, 2.6))
    stage.draw("concrete", tube((0, 0, 1.34), (0, 0, 1.6), 0.09, 12, 0.4))
    for yaw in (0.0, np.pi / 4):
        stage.obstacle(f"{name}_{yaw:.1f}", (0, 0, 0.21), (1.95, 1.95, high), yaw, shadow=False)
        stage.occluder((0, 0, 0.2), (1.8, 1.8, 0.4), yaw, 0.9)
    stage.occluder((0, 0, 0.8), (0.26, 0.26, 1.6))


def _houses(stage: Stage, rng: np.random.Generator) -> None:
    """Build three fronts to the west, north and east; trees and a hedge across the street."""
    x, y = HALF_M
    fronts = (((-x, -y, np.pi / 2), 2 * y), ((-x, y, 0.0), 2 * x), ((x, y, -np.pi / 2), 2 * y))
    for k, (place, length) in enumerate(fronts):
        storeys = int(rng.integers(2, 4))
        facade(stage, f"house_{k}", place, rng, length, storeys, f"plaster_{k}", f"wood_{k}")
    hedge(stage, "hedge", rng, (-x, -y - 4.6), (x, -y - 4.6), rng.uniform(0.9, 1.3))
    for k, along in enumerate(np.linspace(-x, x, 5)):
        spot = (along + rng.uniform(-0.8, 0.8), -y - rng.uniform(6.0, 9.0), 0.0)
        tree(stage, f"tree_{k}", rng, spot, rng.uniform(4.5, 7.0))


def _furnish(stage: Stage, rng: np.random.Generator) -> None:
    """Leave the middle free: benches and pots stand along the fronts, lamps in the corners."""
    x, y = HALF_M
    for k, along in enumerate((-1.4, 1.4)):
        place = (along + rng.uniform(-0.2, 0.2), y - 0.55, rng.uniform(-0.04, 0.04))
        bench(stage, f"bench_{k}", place, rng)
    for k, side in enumerate((-1, 1)):
        along, turn = rng.uniform(-1.5, 1.5), -side * np.pi / 2 + rng.uniform(-0.04, 0.04)
        bench(stage, f"bench_{2 + k}", (side * (x - 0.6), along, turn), rng)
        planter(stage, f"planter_{k}", rng, np.array([side * 4.6, -y + 0.3]), (1.6, 0.5, 0.4))
        lamp_post(stage, f"lamp_{k}", np.array([side * (x - 0.5), -y + 0.5]))
        lamp_post(stage, f"lamp_{2 + k}", np.array([side * (x - 0.7), y - 0.7]))
    for k, side in enumerate((-1, 1)):
        corner = (side * (0.82 * x + rng.uniform(-0.2, 0.2)), y - 0.35)
        beside = [(side * (x - 0.35), sign * rng.uniform(2.2, 2.7)) for sign in (1, -1)]
        for j, spot in enumerate((corner, *beside)):
            potted_plant(stage, f"pot_{k}_{j}", rng, spot)


def _street(ground: Ground) -> None:
    """Lay a kerb at the end of the setts, the street, and soil behind the houses."""
    x, y = HALF_M
    far = 36.0
    ground.draw("asphalt", strip((-far, -y - 4.0), (far, -y), -0.004, 1.024, 0.5))
    ground.draw("soil", merged([strip((-far, -far), (far, -y - 4.0), -0.004, 3.0, 2.0)]))
    stones = [
        box((a + 0.5, -y - 0.06, -0.02), (0.994, 0.12, 0.06), (1.2, 1.2), (a, 0.0))
        for a in np.arange(-x, x)
    ]
    ground.draw("concrete", merged(stones))


def _scatter_leaves(ground: Ground, rng: np.random.Generator) -> None:
    stage = ground.stage
    stage.material("litter", greenery.fallen_leaves(rng, 24, 64))
    spots = rng.uniform(-HALF_M + 0.2, HALF_M - 0.2, (80, 2))
    spots = spots[np.linalg.norm(spots, axis=1) > 1.3]
    places = np.column_stack([spots, np.full(len(spots), 0.003)])
    with stage.object("litter"):
        ground.draw("litter", litter(rng, places, stage.atlases["litter"]))
