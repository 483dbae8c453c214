"""A small laboratory, full of instruments; the camera is carried by hand around its middle."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box
from scenes.geometry.routes import resampled
from scenes.lighting.baked_light import hall_light
from scenes.objects import furniture
from scenes.objects import laboratory_equipment as laboratory
from scenes.pen import Pen, Place, local
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures import interior
from scenes.structures.ground import bake_ground, level, quads, scattered
from scenes.structures.interior import sides
from scenes.surfaces import floor, instruments, masonry, prints, textile, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Carried by hand in a circle: the camera sways and always turns, in a richly textured room."
TAGS = "indoor level textured"
HALF_M = np.array([3.3, 3.0])
HEIGHT_M = 2.8
ISLAND_M = np.array([1.1, 0.9])


class Options(Settings):
    """Options of the laboratory."""

    radius_m: Annotated[float, Field(ge=1.3, le=1.6)] = 1.45
    """Of the circle around the table in the middle, m."""
    laps: Annotated[int, Field(ge=1, le=12)] = 4
    """Number of rounds of the route."""
    clutter: Annotated[float, Field(ge=0, le=1)] = 0.85
    """Share of the places on the benches that are filled."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the laboratory; what lies where, textures and light follow the generator."""
    stage = Stage("lab_circle")
    light = hall_light(rng)
    light = replace(light, ambient_rgb=1.25 * light.ambient_rgb)  # a small, pale room
    _define_materials(stage, rng)
    _walls(stage, rng)
    _benches(stage, rng, settings.clutter)
    _middle(stage, rng)
    _corners(stage, rng)
    with stage.object("floor", Kind.GROUND):  # terrazzo in slabs of half a metre
        corners = quads(-HALF_M, HALF_M, 0.125)
        ground = bake_ground(stage, light, HALF_M)
        ground.draw("floor", level(corners, scattered(rng, corners, 0.5, 1.024)))
    with stage.object("ceiling"):
        interior.ceiling(stage, HALF_M, HEIGHT_M, 0.6, 2.0)
        for px in (-1.6, 1.6):
            for py in (-1.3, 1.3):
                interior.ceiling_panel(stage, np.array([px, py, HEIGHT_M]), (1.2, 0.3))
    return stage.scene(TESTS, TAGS, light, route=_route(rng, settings), reach_m=HALF_M + 0.15)


def _route(rng: np.random.Generator, settings: Options) -> Array:
    """Walk counter-clockwise around the table, on nearly a circle, the same way in each lap."""
    angle = np.linspace(0, 2 * np.pi, 361) + rng.uniform(0, 2 * np.pi)
    bulge = 0.02 * np.sin(2 * angle + rng.uniform(0, 6)) + 0.01 * np.sin(3 * angle)
    radius = settings.radius_m * (1 + bulge)
    lap = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    lap[-1] = lap[0]
    once = resampled(lap, 0.1)
    return np.concatenate([once[:1], *[once[1:]] * settings.laps])


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    fronts = instruments.fronts(rng, 10, (180, 340))
    wraps = instruments.wraps(rng, 10, (128, 256))
    cartons = prints.cartons(rng, 6, 192)
    books = prints.book_rows(rng, 5, (192, 672))
    posters = prints.posters(rng, 8, (420, 300))
    stage.material("floor", floor.terrazzo(rng, 1024))
    stage.material("wall", masonry.painted_wall(rng, (512, 512), (210, 212, 208)))
    stage.material("fronts", fronts, 0.15)
    stage.material("wraps", wraps)
    stage.material("cartons", cartons)
    stage.material("books", books)
    stage.material("posters", posters)
    stage.material("worktop", prints.marble(rng, 512, (84, 90, 96)))
    stage.material("panel", timber.painted(rng, (512, 512), (188, 190, 188)))
    hue = ((172, 178, 182), (116, 142, 152), (182, 168, 140))[rng.integers(3)]
    stage.material("drawer", timber.painted(rng, (512, 512), hue))
    stage.material("beech", timber.wood(rng, (256, 1024), (190, 158, 118)))
    stage.material("holes", instruments.breadboard(rng))
    stage.material("steel", timber.painted(rng, (256, 256), (158, 160, 162)))
    stage.material("plastic", timber.painted(rng, (256, 256), (54, 56, 60)))
    stage.material("glass", timber.painted(rng, (64, 64), (132, 164, 168)))
    for name, tone in (("red", (172, 44, 40)), ("blue", (48, 84, 140)), ("black", (36, 36, 38))):
        stage.material(f"cable_{name}", timber.painted(rng, (64, 64), tone))
    stage.material("gas", timber.painted(rng, (128, 128), (104, 112, 88)))
    stage.material("label", prints.door_signs(rng, 1, 128)[0])
    stage.material("signs", prints.door_signs(rng, 1, 128)[0])
    stage.material("notes", prints.notes(rng, (480, 500)))
    stage.material("cloth", textile.fabric(rng, 128, (60, 66, 78)))
    stage.material("skirting", timber.painted(rng, (128, 256), (104, 108, 110)))
    stage.material("leaf", timber.wood(rng, (512, 512), (150, 118, 84)))
    stage.material("frame", timber.painted(rng, (128, 128), (120, 124, 128)))
    stage.material("ceiling", masonry.painted_wall(rng, (256, 256), (216, 216, 212)), 0.3)
    stage.material("lamp", np.full((8, 8, 3), (244, 244, 238), np.uint8), 0.7)


def _walls(stage: Stage, rng: np.random.Generator) -> None:
    """Build four walls; a door, a whiteboard and posters on the one without a bench."""
    for k, run in enumerate(sides(HALF_M)):
        interior.wall(stage, f"wall_{k}", run, HEIGHT_M, (2.3, 2.3))
    south, _ = sides(HALF_M)[2]
    interior.door(stage, "door", south, rng, 1.0, np.array([0, 0, 1, 1.0]))
    put = Pen(stage, south)
    with stage.object("whiteboard"):
        put("steel", box((3.1, -0.012, 1.4), (1.84, 0.024, 1.14), (0.5, 0.5), bottom=True))
        put("notes", box((3.1, -0.026, 1.4), (1.8, 0.006, 1.1)))
        put("steel", box((3.1, -0.05, 0.83), (1.2, 0.08, 0.02), (0.5, 0.5), bottom=True))
    for k, (run, spots) in enumerate(zip(sides(HALF_M), _POSTER_SPOTS, strict=True)):
        hang = Pen(stage, run[0])
        for j, along in enumerate(spots):
            with stage.object(f"poster_{k}_{j}"):
                low = rng.uniform(1.15, 1.35)
                hang.cell("posters", rng, box((along, -0.004, low + 0.42), (0.6, 0.006, 0.84)))


_POSTER_SPOTS = ((0.5, 6.1), (0.55, 3.0, 5.45), (4.6, 5.4), (0.55, 2.6, 3.4))
"""Positions of posters along the north, east, south and west walls, metres."""


def _benches(stage: Stage, rng: np.random.Generator, clutter: float) -> None:
    """Place benches along three walls, with shelves and instruments; the fourth has the door."""
    lengths = {0: (4.6, (-1.1, 1.1)), 1: (4.2, (-1.15, 1.1)), 3: (4.2, (-1.2, 1.2))}
    for k, (run, length) in enumerate(sides(HALF_M)):
        if k not in lengths:
            continue
        bench_m, shelves = lengths[k]
        back = local(run, length / 2, -0.02)
        laboratory.bench(stage, f"bench_{k}", back, rng, bench_m)
        for j, x in enumerate(shelves):
            laboratory.shelf(stage, f"shelf_{k}_{j}", local(back, x, 0.0), rng, 1.3)
        for j, x in enumerate(np.arange(-bench_m / 2 + 0.35, bench_m / 2 - 0.3, 0.56)):
            if rng.random() < clutter:
                spot = local(back, float(x), -rng.uniform(0.3, 0.36), rng.uniform(-0.15, 0.15))
                _piece(stage, f"piece_{k}_{j}", rng, spot, laboratory.TOP_M)
        if k != 0:
            seat = local(back, rng.uniform(-1.2, 1.2), -0.94)
            laboratory.stool(stage, f"stool_{k}", seat, rng)


def _piece(stage: Stage, name: str, rng: np.random.Generator, place: Place, base_m: float) -> None:
    """Put one random instrument, microscope or tray at a height."""
    draw = rng.random()
    if draw < 0.62:
        laboratory.instrument(stage, name, place, rng, base_m)
    elif draw < 0.74:
        laboratory.microscope(stage, name, place, base_m)
    else:
        laboratory.tray(stage, name, place, rng, base_m)


def _middle(stage: Stage, rng: np.random.Generator) -> None:
    """Place a table for optics within the circle."""
    centre: Place = (0.0, 0.0, rng.uniform(-0.1, 0.1))
    laboratory.island(stage, "table", centre, rng, ISLAND_M)
    laboratory.optics(stage, "optics", local(centre, 0.0, 0.05, 0.1), rng, 0.842)
    for k, (x, turn) in enumerate(((-0.3, 0.0), (0.3, np.pi))):
        spot = local(centre, x, -0.25 if k == 0 else 0.27, turn + rng.normal(0, 0.1))
        laboratory.instrument(stage, f"source_{k}", spot, rng, 0.842)


def _corners(stage: Stage, rng: np.random.Generator) -> None:
    """Place gas bottles, a bin and a filing cabinet in the corners."""
    north, length = sides(HALF_M)[0]
    laboratory.gas_bottles(stage, "gas_bottles", local(north, length - 0.42, -0.02))
    furniture.bin_(stage, "bin", local(north, 0.3, -0.35))
    south, length = sides(HALF_M)[2]
    furniture.cabinet(stage, "cabinet", local(south, length - 0.6, -0.27), rng)
    furniture.bin_(stage, "bin_south", local(south, 1.9, -0.25))
