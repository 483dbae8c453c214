"""A car park: a wide field of fine, dark asphalt that looks the same everywhere."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import Mesh, Vector, merged, patch, tube
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import sun
from scenes.objects.plants import hedge, tree
from scenes.objects.props import grass_tufts, lamp_post
from scenes.objects.vehicles import PAINTS, car
from scenes.pen import one_object
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import Ground, bake_ground, level, quads, scattered, strip
from scenes.structures.surround import kerb
from scenes.surfaces import floor, greenery, masonry, prints, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Self-similar asphalt without landmarks: any patch of the ground resembles any other."
TAGS = "outdoor level textured"
BAY_M = (2.5, 5.0)
AISLE_M = 13.0
"""Depth of the free field between the two rows of bays."""
PAINT_M = 0.0006
KERB_M = 0.08
TILE_M = 0.5


class Options(Settings):
    """Options of the car park."""

    bays: Annotated[int, Field(ge=8, le=16)] = 10
    """Bays in each of the two rows."""
    parked: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the bays with a parked car."""
    wear: Annotated[float, Field(ge=0, le=1)] = 0.6
    """Wear of the markings: 0 fresh, 1 nearly gone."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the car park; cars, markings, trees and light follow the generator."""
    stage = Stage("asphalt")
    half = np.array([settings.bays * BAY_M[0] + 1.0, AISLE_M + 2 * BAY_M[1]]) / 2
    light = sun(rng, (38, 60))
    _define_materials(stage, rng, settings.wear)
    _park(stage, rng, settings)
    _surround(stage, rng, half)
    ground = bake_ground(stage, light, half + 4, (rng, 0.10), 0.08)
    _lay_ground(ground, rng, half)
    _mark(ground, rng, settings)
    return stage.scene(TESTS, TAGS, light, sky.town_sky(rng), route=_route(rng), reach_m=half + 0.6)


def _route(rng: np.random.Generator) -> Array:
    """Drive around in the free field, counter-clockwise."""
    x, y = 6.2, 3.4
    corners = np.array([(x, -y), (x, y), (0.2, y), (-x, y), (-x, -y), (-0.2, -y)])
    return rounded_loop(corners + rng.uniform(-0.35, 0.35, corners.shape), radius_m=1.2)


def _define_materials(stage: Stage, rng: np.random.Generator, wear: float) -> None:
    asphalt = floor.asphalt(rng, 1024)
    stage.material("asphalt", asphalt)
    stage.material("marking", floor.road_paint(rng, (160, 2048), wear, asphalt))
    stage.material("cover", floor.iron_cover(rng, 512))
    stage.material("concrete", masonry.concrete(rng, (1024, 1024)))
    stage.material("lawn", greenery.lawn(rng, 1024))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("foliage", greenery.leaves(rng, 1, 512)[0])
    stage.material("bark", timber.wood(rng, (256, 256), (96, 82, 68)))
    stage.material("iron", timber.painted(rng, (256, 256), (92, 96, 96)))
    stage.material("rubber", timber.painted(rng, (128, 128), (34, 34, 36)))
    stage.material("glass", timber.painted(rng, (128, 128), (52, 60, 68)))
    stage.material("lamps", timber.painted(rng, (64, 64), (188, 150, 140)))
    stage.material("plates", prints.door_signs(rng, 1, 96)[0])
    for k, paint in enumerate(PAINTS):
        stage.material(f"paint_{k}", masonry.painted_wall(rng, (128, 128), paint))


def _park(stage: Stage, rng: np.random.Generator, settings: Options) -> None:
    """Park cars in a share of the bays."""
    left = -settings.bays * BAY_M[0] / 2
    for row, side in enumerate((-1, 1)):
        for k in range(settings.bays):
            if rng.random() > settings.parked:
                continue
            spot = np.array([left + (k + 0.5) * BAY_M[0], side * (AISLE_M + BAY_M[1]) / 2])
            spot += rng.normal(0, (0.08, 0.18))
            nose_in = rng.random() < 0.7
            yaw = side * (np.pi / 2 if nose_in else -np.pi / 2) + rng.normal(0, 0.02)
            paint = f"paint_{rng.integers(len(PAINTS))}"
            car(stage, f"car_{row}_{k}", (spot[0], spot[1], yaw), rng, paint)


def _surround(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Place bollards at the open end, lamp posts, a hedge along one row and trees beyond."""
    x, y = half
    for k, across in enumerate(np.arange(-AISLE_M / 2 + 0.6, AISLE_M / 2, 1.6)):
        _bollard(stage, f"bollard_{k}", np.array([x - 0.35, across + rng.normal(0, 0.02)]))
    for k, sign in enumerate(((1, 1), (-1, 1), (1, -1), (-1, -1))):
        lamp_post(stage, f"lamp_{k}", (half + 0.7) * sign * (0.55, 1))
    hedge(stage, "hedge", rng, (-x, y + 1.3), (x, y + 1.3), rng.uniform(1.0, 1.4))
    for k in range(12):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 12
        spot = (half + rng.uniform(3.5, 9.0)) * (1.15 * np.cos(angle), 1.15 * np.sin(angle))
        if (np.abs(spot) < half + 2.2).all():
            spot *= 1.45
        tree(stage, f"tree_{k}", rng, (*spot, 0.0), rng.uniform(4.5, 7.5))


@one_object
def _bollard(stage: Stage, name: str, centre: Array) -> None:
    x, y = centre
    stage.draw("iron", tube((x, y, 0), (x, y, 0.85), 0.045, 12))
    stage.draw("lamps", tube((x, y, 0.68), (x, y, 0.76), 0.0465, 12))
    stage.draw("iron", tube((x, y, 0.85), (x, y, 0.9), 0.045, 12, 0.5))
    stage.obstacle(name, (x, y, 0.45), (0.1, 0.1, 0.9))


def _lay_ground(ground: Ground, rng: np.random.Generator, half: Array) -> None:
    """Lay asphalt up to the kerb, and lawn beyond."""
    stage = ground.stage
    x, y = half
    corners = quads((-x - 0.1, -y - 0.1), (x + 0.1, y + 0.1), 0.25)
    with stage.object("asphalt", Kind.GROUND):
        ground.draw("asphalt", level(corners, scattered(rng, corners, TILE_M, 1.024)))
    with stage.object("kerb"):
        ground.draw("concrete", merged(kerb(rng, half, 0.15, KERB_M)))
    with stage.object("lawn", Kind.GROUND):
        edge, far = 0.14, 40.0
        sides = (
            ((x + edge, -y - edge), (x + 4, y + edge), 0.4),
            ((-x - 4, -y - edge), (-x - edge, y + edge), 0.4),
            ((-x - 4, y + edge), (x + 4, y + 4), 0.4), ((-x - 4, -y - 4), (x + 4, -y - edge), 0.4),
            ((x + 4, -far), (far, far), 2.0), ((-far, -far), (-x - 4, far), 2.0),
            ((-x - 4, y + 4), (x + 4, far), 2.0), ((-x - 4, -far), (x + 4, -y - 4), 2.0),
        )  # fmt: skip
        turf = merged([strip(low, high, KERB_M - 0.02, 4.0, cell) for low, high, cell in sides])
        ground.draw("lawn", turf)
        feet = np.concatenate([_fringe(rng, half, axis, 220) for axis in (0, 1)])
        ground.draw("lawn", grass_tufts(rng, feet).moved((0, 0, KERB_M - 0.02)))


def _fringe(rng: np.random.Generator, half: Array, axis: int, count: int) -> Array:
    """Draw the feet (N, 2) of uncut grass behind the kerb on both sides across an axis."""
    feet = np.empty((count, 2))
    feet[:, axis] = rng.choice((-1, 1), count) * (half[axis] + 0.2 + rng.exponential(0.2, count))
    feet[:, 1 - axis] = rng.uniform(-half[1 - axis], half[1 - axis], count)
    return feet


def _mark(ground: Ground, rng: np.random.Generator, settings: Options) -> None:
    """Paint bays and two arrows, and add a shaft cover."""
    stage = ground.stage
    lines: list[Mesh] = []
    left = -settings.bays * BAY_M[0] / 2
    for side in (-1, 1):
        for k in range(settings.bays + 1):
            start = (left + k * BAY_M[0], side * AISLE_M / 2)
            lines.append(_line(rng, start, (start[0], side * (AISLE_M / 2 + BAY_M[1]))))
    for side in (-1, 1):
        tip = np.array([rng.uniform(-4, 4), side * rng.uniform(3.0, 3.8)])
        along = np.array([-side, 0.0])
        across = np.array([0.0, 0.42])
        lines.append(_line(rng, tip - 1.7 * along, tip - 0.08 * along))
        lines += [_line(rng, tip - 0.55 * along + s * across, tip) for s in (-1, 1)]
    with stage.object("markings", Kind.GROUND):
        ground.draw("marking", *lines)
    with stage.object("shaft_cover", Kind.GROUND):
        x, y = rng.uniform(-3, 3), rng.uniform(-1.2, 1.2)
        ground.draw("cover", patch((x, y, 2 * PAINT_M), (0.6, 0, 0), (0, 0.6, 0), (3, 3)))


def _line(rng: np.random.Generator, start: Vector, end: Vector, width_m: float = 0.15) -> Mesh:
    """Build a painted stripe between two (2,) points with a random stretch of the texture."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    way = b - a
    length = float(np.linalg.norm(way))
    side = width_m * np.array([-way[1], way[0]]) / length
    cells = (max(1, round(length / 0.25)), 1)
    raised = PAINT_M * rng.uniform(0.8, 1.2)  # stripes that cross do not flicker
    origin = (*(a - side / 2), raised)
    return patch(origin, (*way, 0), (*side, 0), cells, (2.048, width_m), (rng.random(), 0.0))
