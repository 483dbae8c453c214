"""A straight residential avenue as a car sees it: houses, trees, parked cars and a green strip."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light, lamp
from scenes.objects.plants import hedge, street_tree
from scenes.objects.props import bush
from scenes.objects.street_furniture import hoarding, street_lamp, traffic_sign, wheeled_bin
from scenes.objects.vehicles import PAINTS, car
from scenes.scene import Scene
from scenes.stage import Stage
from scenes.structures import avenue
from scenes.structures.avenue import BAY_M, LANE_M, PAVED_M, STRIP_M, VERGE_M, Avenue
from scenes.structures.fences import KINDS, fence, scaffold
from scenes.structures.house import house
from scenes.structures.paths import BlockGround
from scenes.surfaces import floor, fronts, greenery, masonry, prints, signs, sky, timber
from scenes.surfaces.noise import fractal
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = (
    "A straight street at the scale of a car: strong contrast, far points, turns only at its ends."
)
TAGS = "outdoor level long textured"
DRIVE_M = (STRIP_M + LANE_M) / 2
"""Distance of the route from the middle of the avenue."""
FRONTS_M = 11.6
"""Least distance of the houses from it."""
WALLS = ("white", "white", "cream", "brick", "blocks")


class Options(Settings):
    """Options of the street."""

    length_m: Annotated[float, Field(ge=70, le=120)] = 76.0
    """Length of its straight part between the turns, m."""
    parked: Annotated[float, Field(ge=0, le=1)] = 0.45
    """Share of the bays with a parked car."""
    trees: Annotated[float, Field(ge=0, le=1)] = 0.85
    """Share of the places for trees that are planted."""
    wear: Annotated[float, Field(ge=0, le=1)] = 0.6
    """Wear of the road: patches, cracks and rubbed markings."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the street; houses, gardens, cars, textures and light follow the generator."""
    stage = Stage("street")
    length = settings.length_m
    turns = np.array([(-3.0, 4.0), (length - 4.0, length + 3.0)])
    road = Avenue((-20.0, length + 20.0), turns, (-8.0, length + 8.0))
    light = _sunlight(rng)
    _define_materials(stage, rng, settings.wear)
    _build_up(stage, rng, road)
    _park(stage, rng, road, settings.parked)
    _plant(stage, rng, road, settings.trees)
    _furnish(stage, rng, road)
    reach = np.array([(road.ends[0], -FRONTS_M - 2), (road.ends[1], FRONTS_M + 2)])
    avenue.lay(BlockGround(stage, rng, light, *reach), rng, road, settings.wear)
    around = (-6.0, -FRONTS_M, length + 6.0, FRONTS_M)
    return stage.scene(
        TESTS, TAGS, light, sky.town_sky(rng, clear=True), route=_route(rng, length), reach_m=around
    )


def _route(rng: np.random.Generator, length_m: float) -> Array:
    """Drive along one side and back on the other, swaying by a few centimetres."""
    y = DRIVE_M
    corners = np.array([(length_m, -y), (length_m, y), (0.0, y), (0.0, -y)])
    route = rounded_loop(corners, radius_m=3.0)
    fade = np.clip(np.minimum(route[:, 0] - 4, length_m - 4 - route[:, 0]) / 6, 0, 1)
    waves = rng.uniform(22, 34, 2), rng.uniform(0, 2 * np.pi, 2)
    lane = (route[:, 1] > 0).astype(int)
    sway = 0.06 * np.sin(2 * np.pi * route[:, 0] / waves[0][lane] + waves[1][lane])
    return route + np.column_stack([0 * sway, sway * fade**2 * (3 - 2 * fade)])


def _sunlight(rng: np.random.Generator) -> Light:
    """Shine from the clear sky, from one side of the street or the other."""
    side = np.pi / 2 * rng.choice((-1, 1))
    return lamp(
        (side + rng.uniform(-1.0, 1.0), rng.uniform(36, 50)),
        on_ground=(0.56, 0.54, 0.50),
        fill=(0.27, 0.283, 0.305),
        ambient=(0.17, 0.175, 0.19),
    )


def _define_materials(stage: Stage, rng: np.random.Generator, wear: float) -> None:
    tarmac = floor.roadway(rng, 1024)
    stage.material("white", fronts.roughcast(rng, 768, (232, 228, 218)))
    stage.material("cream", fronts.roughcast(rng, 768, (198, 174, 138)))
    brick = ((150, 92, 74), (104, 66, 58))
    stage.material("brick", fronts.blockwork(rng, (768, 768), 52, 16, brick))
    block = ((176, 170, 160), (108, 104, 100))
    stage.material("blocks", fronts.blockwork(rng, (512, 512), 14, 8, block))
    stage.material("panes", fronts.panes(rng, 12, (160, 112)))
    stage.material("slats", fronts.slats(rng, 256, (188, 184, 174)))
    stage.material("tiles", fronts.roof_tiles(rng, 512, (96, 60, 50)))
    stage.material("foliage", greenery.leaves(rng, 1, 512)[0])
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("slabs", floor.paving_slabs(rng, 9, 256))
    stage.material(
        "bays", fronts.blockwork(rng, (1024, 1024), 20, 10, ((150, 142, 134), (104, 100, 98)))
    )
    stage.material("asphalt", tarmac)
    stage.material("mended", (0.7 * floor.roadway(rng, 512)).astype(np.uint8))
    stage.material("marking", floor.road_paint(rng, (96, 1024), wear, tarmac))
    stage.material("cover", floor.iron_cover(rng, 256))
    stage.material("turf", greenery.lawn(rng, 1024, patchy=0.3))
    tone = 0.42 + 0.3 * fractal(rng, (256, 256), (2, 64), 0.4)
    stage.material("blades", greenery.grass_tones(tone))
    stage.material("litter", greenery.fallen_leaves(rng, 9, 48))
    stage.material("concrete", masonry.concrete(rng, (512, 512)))
    stage.material("timber", timber.wood(rng, (256, 512), (142, 112, 80)))
    stage.material("bark", timber.wood(rng, (128, 256), (84, 72, 60)))
    stage.material("posters", prints.posters(rng, 3, (252, 350)))
    stage.material("signs", signs.traffic_signs(128))
    stage.material("plates", prints.door_signs(rng, 1, 96)[0])
    for name, rgb in (
        ("frame", (226, 226, 220)), ("door", (86, 58, 44)), ("iron", (44, 46, 48)),
        ("steel", (150, 154, 156)), ("tar", (34, 33, 33)), ("rubber", (30, 30, 32)),
        ("glass", (38, 44, 50)), ("lamps", (188, 150, 140)),
    ):  # fmt: skip
        stage.material(name, timber.painted(rng, (128, 128), rgb))
    for k, paint in enumerate(PAINTS[:4]):
        stage.material(f"paint_{k}", timber.painted(rng, (128, 128), paint))


def _build_up(stage: Stage, rng: np.random.Generator, road: Avenue) -> None:
    """Line both sides with houses behind gardens, and close both ends."""
    number = 0
    for side in (-1, 1):
        along = road.ends[0] + rng.uniform(0, 3)
        while along < road.ends[1] - 9:
            wide, back = float(rng.uniform(8.5, 15)), float(rng.uniform(0, 2.2))
            start = along if side > 0 else along + wide
            place = (start, side * (FRONTS_M + back), 0.0 if side > 0 else np.pi)
            storeys, wall = int(rng.integers(2, 4)), str(rng.choice(WALLS))
            house(stage, f"house_{number}", place, rng, wide, storeys, wall)
            if rng.random() < 0.2:
                scaffold(stage, f"scaffold_{number}", place, rng, wide, 2.8 * storeys)
            _front_garden(stage, rng, number, (along, side, wide))
            along += wide + float(rng.choice((0.3, rng.uniform(2, 6))))
            number += 1
    for end, yaw in ((road.ends[0] - 10, np.pi / 2), (road.ends[1] + 10, -np.pi / 2)):
        for across in (-14.0, 0.5):
            place = (end, across if yaw > 0 else -across, yaw)
            house(stage, f"house_{number}", place, rng, 13.5, 3, str(rng.choice(WALLS)))
            number += 1


def _front_garden(
    stage: Stage, rng: np.random.Generator, number: int, plot: tuple[float, float, float]
) -> None:
    """Bound a garden, x, side and width, by a fence or a hedge, and plant bushes in it."""
    along, side, wide = plot
    y = side * (PAVED_M + 0.35)
    kind = str(rng.choice([*KINDS, "hedge", "none"]))
    if kind == "hedge":
        ends = (along, y), (along + wide, y)
        hedge(stage, f"hedge_{number}", rng, *ends, rng.uniform(0.8, 1.5))
    elif kind != "none":
        place = (along if side > 0 else along + wide, y, 0.0 if side > 0 else np.pi)
        fence(stage, f"fence_{number}", place, rng, wide, kind)
    for k in range(int(rng.integers(1, 3))):
        foot = (along + rng.uniform(0.5, wide - 0.5), side * (PAVED_M + rng.uniform(0.9, 1.5)), 0.0)
        bush(stage, f"bush_{number}_{k}", rng, np.array(foot), rng.uniform(0.3, 0.6))


def _park(stage: Stage, rng: np.random.Generator, road: Avenue, share: float) -> None:
    for side in (-1, 1):
        for k, x in enumerate(np.arange(road.ends[0] + 3.1, road.ends[1] - 3, 6.2)):
            if rng.random() < share:
                spot = rng.normal((x, side * (LANE_M + BAY_M) / 2), (0.3, 0.06))
                yaw = (np.pi if side > 0 else 0.0) + rng.normal(0, 0.015)
                paint = f"paint_{rng.integers(4)}"
                car(stage, f"car_{k}_{'rl'[side > 0]}", (spot[0], spot[1], yaw), rng, paint)


def _plant(stage: Stage, rng: np.random.Generator, road: Avenue, share: float) -> None:
    """Plant trees on the green strip and beside the pavements."""
    number = 0
    for start, end in road.strips:
        for x in np.arange(start + 3, end - 2, 8.5):
            if rng.random() < share:
                foot = (x + rng.uniform(-0.8, 0.8), rng.uniform(-0.7, 0.7), VERGE_M)
                street_tree(stage, f"tree_{number}", rng, foot, rng.uniform(4.2, 6.5), 1100)
                number += 1
    for side in (-1, 1):
        for x in np.arange(road.ends[0] + 4, road.ends[1] - 4, 12.5):
            if rng.random() < 0.7 * share:
                foot = (x + rng.uniform(-3, 3), side * (PAVED_M + rng.uniform(0.9, 1.6)), 0.0)
                street_tree(stage, f"tree_{number}", rng, foot, rng.uniform(4.5, 7.5), 1100)
                number += 1


def _furnish(stage: Stage, rng: np.random.Generator, road: Avenue) -> None:
    """Stand lamps, signs, hoardings and waste bins beside the road."""
    number = 0
    for start, end in road.strips:
        for x in np.arange(start + 6, end - 2, 17.0):
            street_lamp(stage, f"lamp_{number}", (x, 1.4, 0.0), rng.uniform(6.0, 7.0))
            number += 1
    for k, x in enumerate(np.arange(road.ends[0] + 5, road.ends[1] - 5, 14.0)):
        side = float(rng.choice((-1, 1)))
        yaw = -np.pi / 2 if side < 0 else np.pi / 2  # they face who drives on that side
        spot = (x + rng.uniform(-3, 3), side * (BAY_M + 0.4))
        traffic_sign(stage, f"sign_{k}", (*spot, yaw), int(rng.integers(3)))
        if rng.random() < 0.5:
            wheeled_bin(
                stage, f"bin_{k}", (spot[0] + 2, -side * (PAVED_M - 0.4), rng.uniform(0, 6)), rng
            )
    for k, x in enumerate(rng.uniform(road.ends[0] + 20, road.ends[1] - 20, 2)):
        yaw = -np.pi / 2 + 0.6 if k else np.pi / 2 + 0.6
        hoarding(stage, f"hoarding_{k}", (x, (1 if k else -1) * (PAVED_M + 1.0), yaw), rng)
