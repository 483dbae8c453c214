"""A service yard after sunset: pools of lamplight, dark stretches, a mains flicker."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box, patch, tube
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light
from scenes.lighting.lamps import Lamplight
from scenes.objects.props import bench, lamp_post, planter
from scenes.objects.storage import cone, load, standing_drums
from scenes.pen import Pen, Place, piece
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import level, quads, tiled
from scenes.structures.surround import brick_wall, hang_posters, plaster_wall
from scenes.surfaces import greenery, masonry, prints, signs, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Little light: pools under lamps, darkness between, mains flicker, and lamps that fail."
TAGS = "outdoor level dark flicker"
HALF_M = np.array([7.2, 5.4])
ROOF_Y_M = -1.9
"""A roof covers the yard south of this."""
ROOF_Z_M = 2.7
FLAG_M = 0.5
MAINS_HZ = 100.0
"""Lamps brighten twice in each period of 50 Hz mains."""
EPISODES = 48


class Options(Settings):
    """Options of the yard."""

    level: Annotated[float, Field(gt=0, le=1)] = 0.035
    """Mean illuminance over that of a sunny scene."""
    flicker: Annotated[float, Field(ge=0, le=1)] = 0.4
    """Depth of the mains flicker, as a share of the mean."""
    unrest: Annotated[float, Field(ge=0, le=1)] = 0.6
    """Depth to which lamps dim and recover over seconds; 0 keeps them constant."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the yard; layout, textures, lamps and their failures follow the generator."""
    stage = Stage("dusk")
    _define_materials(stage, rng)
    lamps = _lamps(stage, rng)
    _walls(stage, rng)
    _roof(stage, rng)
    _furnish(stage, rng)
    with stage.object("flagstones", Kind.GROUND):
        corners = quads(-HALF_M - 0.5, HALF_M + 0.5, 0.125)
        stage.draw("flags", level(corners, tiled(rng, corners, FLAG_M, stage.atlases["flags"])))
    light = _evening()
    places, powers = (np.array(values) for values in zip(*lamps, strict=True))
    lamplight = Lamplight(places, powers, stage.occluders, light)
    dim = sky.town_sky(rng) / 255
    night = (255 * dim**1.3 * np.array([0.30, 0.33, 0.44])).astype(np.uint8)
    built = TESTS, TAGS, light, night, lamplight
    scene = stage.scene(*built, route=_route(rng), reach_m=HALF_M + 0.4)
    return replace(scene, brightness=_brightness(rng, settings))


def _brightness(rng: np.random.Generator, settings: Options) -> Callable[[Array], Array]:
    """Flicker with the mains around a level that steps and drifts every few seconds."""
    lengths = rng.uniform(3.0, 9.0, EPISODES)
    turns = rng.uniform(0.08, 2.5, EPISODES)  # how long a change takes: switched or dimmed
    depth = settings.unrest * rng.beta(0.8, 0.8, EPISODES)
    levels = (1 - depth) / (1 - depth).mean()
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    times = np.column_stack([starts[:-1], starts[1:] - np.minimum(turns, 0.8 * lengths)]).ravel()
    times = np.append(times, starts[-1])
    steps = np.append(np.repeat(levels, 2), levels[0])
    phase = rng.uniform(0, 2 * np.pi)

    def brightness(time_s: Array) -> Array:
        time_s = np.asarray(time_s, dtype=float)
        slow = np.interp(time_s % starts[-1], times, steps)
        mains = 1 + settings.flicker * np.cos(2 * np.pi * MAINS_HZ * time_s + phase)
        return settings.level * slow * mains

    return brightness


def _route(rng: np.random.Generator) -> Array:
    """Drive around the yard, half of it under the roof."""
    x, y = HALF_M - 1.35
    corners = np.array([
        (x, -y), (x, y), (0.4 * x, y), (0.1 * x, y - 0.7), (-0.4 * x, y - 0.7), (-0.6 * x, y),
        (-x, y), (-x, -y),
        (-0.4 * x, -y), (-0.1 * x, -y + 0.5), (0.35 * x, -y + 0.5), (0.6 * x, -y),
    ])  # fmt: skip
    return rounded_loop(corners + rng.uniform(-0.08, 0.08, corners.shape), radius_m=0.9)


def _evening() -> Light:
    """Build lamps of a warm white over the rest of the sky's light."""
    elevation = np.radians(62)
    return Light(
        key=np.array([np.cos(elevation), 0.0, np.sin(elevation)]),
        key_rgb=np.array([1.12, 0.93, 0.66]),
        fill_rgb=np.array([0.075, 0.088, 0.115]),
        ambient_rgb=np.array([0.055, 0.06, 0.072]),
    )


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("flags", np.stack([masonry.slab(rng, 500, 7) for _ in range(20)]))
    stage.material("cartons", prints.cartons(rng, 6, 256))
    tones = ((58, 84, 116), (120, 58, 46), (70, 92, 76))
    stage.material("drums", signs.drums(rng, tones, (256, 512)))
    yellow, black = (206, 164, 52), (52, 50, 48)
    stage.material("concrete", masonry.concrete(rng, (1024, 1024)))
    stage.material("mortar", masonry.concrete(rng, (512, 512), 160.0))
    stage.material("plaster", masonry.plaster(rng, (1024, 2048), (188, 178, 160)))
    stage.material("shutter", signs.shutter(rng, (1024, 1024), (112, 122, 128)))
    stage.material("hazard", signs.stripes(rng, (256, 256), (yellow, black), 32))
    stage.material("paint", signs.worn_paint(rng, (256, 1024), (208, 206, 198), 0.6))
    stage.material("grate", signs.grate(256))
    stage.material("soil", greenery.soil(rng, 256))
    stage.material("leaves", greenery.foliage(rng, 512, 0.0))
    stage.material("pine", timber.wood(rng, (256, 1024), (168, 138, 100)))
    stage.material("timber", timber.wood(rng, (256, 1024), (142, 108, 74)))
    stage.material("iron", timber.painted(rng, (256, 256), (74, 78, 78)))
    stage.material("container", timber.painted(rng, (512, 512), (66, 98, 82)))
    stage.material("dark", timber.painted(rng, (128, 128), (56, 56, 58)))
    stage.material("cone", timber.painted(rng, (128, 128), (204, 92, 44)))
    stage.material("band", timber.painted(rng, (128, 128), (214, 212, 206)))
    stage.material("bulb", np.full((8, 8, 3), (255, 240, 206), np.uint8), 0.95)


def _lamps(stage: Stage, rng: np.random.Generator) -> list[tuple[Array, float]]:
    """Hang and stand the lamps; returns place and power of each."""
    x, y = HALF_M
    lamps: list[tuple[Array, float]] = []
    for k, (px, py) in enumerate(((-0.48 * x, 1.0), (0.52 * x, 0.6))):
        foot = np.array([px, py]) + rng.uniform(-0.3, 0.3, 2)
        lamp_post(stage, f"lamp_{k}", foot)
        with stage.object(f"lamp_{k}"):
            stage.draw("bulb", tube((*foot, 3.2), (*foot, 3.06), 0.09, 12, 0.8))
        lamps.append((np.array([*foot, 3.5]), rng.uniform(7, 10)))
    walls = ((-0.75 * x, y, 0.0), (0.15 * x, y, 0.0), (x, 0.55 * y, -np.pi / 2))
    for k, (px, py, yaw) in enumerate((*walls, (-x, -0.35 * y, np.pi / 2))):
        place: Place = (px + rng.uniform(-0.2, 0.2), py, yaw)
        put = Pen(stage, place)
        with stage.object(f"wall_lamp_{k}"):
            put("iron", box((0, -0.08, 2.05), (0.3, 0.16, 0.05), bottom=True))
            put("bulb", box((0, -0.09, 2.0), (0.22, 0.1, 0.05), bottom=True))
        out = 0.26 * np.array([np.sin(yaw), -np.cos(yaw)])
        lamps.append((np.array([place[0] + out[0], place[1] + out[1], 2.0]), rng.uniform(2.2, 4)))
    for k, px in enumerate((-0.55 * x, 0.42 * x)):
        spot = np.array([px + rng.uniform(-0.3, 0.3), 0.5 * (ROOF_Y_M - y)])
        with stage.object(f"tube_{k}"):
            stage.draw("bulb", box((*spot, ROOF_Z_M - 0.05), (1.2, 0.09, 0.06), bottom=True))
        for dx in (-0.4, 0.4):
            place_m = np.array([spot[0] + dx, spot[1], ROOF_Z_M - 0.15])
            lamps.append((place_m, rng.uniform(2.6, 4.2)))
    return lamps


def _walls(stage: Stage, rng: np.random.Generator) -> None:
    """Enclose the yard: brick to the north and east, plaster elsewhere, shutters and bills."""
    x, y = HALF_M
    stage.material("wall_bricks", masonry.wall_bricks(rng, 64, (48, 140)))
    stage.material("posters", prints.posters(rng, 8, (420, 300)))
    south, west = (x, -y, np.pi), (-x, -y, np.pi / 2)
    brick_wall(stage, "wall_north", (-x, y, 0.0), rng, 2 * x, 3.0)
    brick_wall(stage, "wall_east", (x, y, -np.pi / 2), rng, 2 * y, 3.4)
    plaster_wall(stage, "wall_south", south, rng, 2 * x, 3.2)
    plaster_wall(stage, "wall_west", west, rng, 2 * y, 3.0)
    with stage.object("posters"):
        for wall, length in ((south, 2 * x), (west, 2 * y)):
            spots = [
                (along + rng.uniform(0, 0.5), rng.uniform(0.5, 0.9), 0.6, 0.84)
                for along in np.arange(0.8, length - 1.5, 2.3)
            ]
            hang_posters(stage, rng, wall, spots)
    for k, (wall, along) in enumerate((((x, -y, np.pi), 4.2), ((-x, y, 0.0), 10.4))):
        with stage.object(f"shutter_{k}"):
            put = Pen(stage, wall)
            put("shutter", box((along, -0.03, 1.15), (2.0, 0.05, 2.3), (2.0, 2.3), cell_m=0.25))
            for side in (-1.06, 1.06):
                put("iron", box((along + side, -0.05, 1.18), (0.12, 0.1, 2.36), cell_m=0.25))


def _roof(stage: Stage, rng: np.random.Generator) -> None:
    """Cover the south of the yard by a concrete roof on columns."""
    x, y = HALF_M
    middle, depth = 0.5 * (ROOF_Y_M - y), ROOF_Y_M + y
    with stage.object("roof"):
        centre = (0, middle, ROOF_Z_M + 0.1)
        stage.draw("concrete", box(centre, (2 * x, depth, 0.2), (1.2, 1.2), bottom=True))
    stage.occluder((0, middle, ROOF_Z_M + 0.12), (2 * x, depth, 0.2))
    for k, px in enumerate(np.linspace(-0.72, 0.72, 5) * x):
        with stage.object(f"column_{k}"):
            centre, size = (px, ROOF_Y_M - 0.2, ROOF_Z_M / 2), (0.32, 0.32, ROOF_Z_M)
            stage.draw("concrete", box(centre, size, (1.2, 1.2), rng.random(2), 0.15))
            guard = box((px, ROOF_Y_M - 0.2, 0.4), (0.335, 0.335, 0.5), (0.5, 0.5), cell_m=0.12)
            stage.draw("hazard", guard)
        stage.obstacle(f"column_{k}", centre, (0.3, 0.3, ROOF_Z_M))


def _furnish(stage: Stage, rng: np.random.Generator) -> None:
    """Fill the middle and the edges; mark bays and gratings on the ground."""
    x, y = HALF_M
    planter(stage, "planter", rng, np.array([0.08 * x, 0.95]), (1.8, 0.8, 0.45))
    bench(stage, "bench", (0.7, -0.5, rng.uniform(-0.2, 0.2)), rng)
    _container(stage, "container_0", (-0.62 * x, -0.5, 0.15))
    _container(stage, "container_1", (0.6 * x, -0.75, np.pi / 2))
    standing_drums(stage, "drum", rng, np.array([2.45, -0.6]))
    for k, (px, py) in enumerate(((-1.85, 0.9), (-1.5, -0.85))):
        place: Place = (px, py, rng.uniform(0, 3))
        with stage.object(f"pallet_{k}"):
            load(stage, rng, place, 0.0)
        Pen(stage, place, f"pallet_{k}").solid((1.2, 0.8, 0.9), shadow=False)
    for k, (px, py) in enumerate(((-x + 0.5, y - 0.5), (x - 0.45, -y + 0.5), (x - 0.5, 0.1 * y))):
        cone(stage, f"cone_{k}", (px, py, rng.uniform(0, 1.5)))
    with stage.object("markings", Kind.GROUND):
        for k in range(5):
            corner = (0.86 * x, -2.0 + k * 1.1, 0.0007)
            stage.draw("paint", patch(corner, (0, 0.09, 0), (-1.9, 0, 0), (1, 10), (0.25, 1.0)))
        for px in (-0.5 * x, 0.5 * x):
            drain = patch((px - 0.2, -y + 1.05, 0.0007), (0.4, 0, 0), (0, 0.4, 0), (3, 3))
            stage.draw("grate", drain)


@piece
def _container(put: Pen) -> None:
    """Put a refuse container of 1.25 x 0.9 m on castors."""
    put("container", box((0, 0, 0.6), (1.2, 0.85, 0.9), (1.0, 1.0), cell_m=0.15))
    put("container", box((0, 0, 1.07), (1.26, 0.92, 0.06), (1.0, 1.0), cell_m=0.2, bottom=True))
    put("dark", box((0, 0.2, 1.15), (1.2, 0.5, 0.1), cell_m=0.2))
    for x in (-0.4, -0.13, 0.13, 0.4):
        for y in (-0.435, 0.435):
            put("container", box((x, y, 0.6), (0.05, 0.03, 0.86), (1.0, 1.0), cell_m=0.2))
    for x in (-0.5, 0.5):
        for y in (-0.33, 0.33):
            put("dark", tube((x - 0.025, y, 0.075), (x + 0.025, y, 0.075), 0.075, 12))
    put.solid((1.26, 0.92, 1.15), shadow=False)
    put.shade(0.62, (1.2, 0.86, 0.95))
