"""A museum hall with paintings and sculptures, in which the rover stops repeatedly."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box, tube
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import hall_light
from scenes.objects import exhibits
from scenes.pen import Pen, Place, local
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures import interior
from scenes.structures.ground import bake_ground, coursed
from scenes.structures.interior import sides
from scenes.surfaces import floor, masonry, prints, textile, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "The rover stands still half of the time: the estimate must not drift while it stands."
TAGS = "indoor level"
HALF_M = np.array([8.0, 5.0])
HEIGHT_M = 3.6
SCREEN_M = (3.4, 0.24, 2.5)
"""Full size of a free-standing wall with paintings on both sides."""
PLANK_M = 0.14
HUES = ((92, 112, 116), (128, 84, 74), (104, 112, 88), (86, 88, 110))


class Options(Settings):
    """Options of the hall."""

    paintings: Annotated[float, Field(ge=0, le=1)] = 0.85
    """Share of the places on the walls that have a painting."""
    sculptures: Annotated[int, Field(ge=0, le=8)] = 7
    """Number of pedestals."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the hall; exhibits, colours, planks and light follow the generator."""
    stage = Stage("stop_and_go")
    light = hall_light(rng)
    light = replace(light, ambient_rgb=1.3 * light.ambient_rgb)  # white walls all around
    _define_materials(stage, rng)
    _walls(stage, rng, settings.paintings)
    _screens(stage, rng)
    _exhibit(stage, rng, settings.sculptures)
    ground = bake_ground(stage, light, HALF_M)
    with stage.object("parquet", Kind.GROUND):
        planks = stage.atlases["planks"]
        ground.draw("planks", coursed(rng, HALF_M, PLANK_M, (0.8, 1.1), planks, 4))
    with stage.object("ceiling"):
        _ceiling(stage)
    return stage.scene(TESTS, TAGS, light, route=_route(rng), reach_m=HALF_M + 0.2)


def _route(rng: np.random.Generator) -> Array:
    """Go around the screens, counter-clockwise, a little closer to one wall, then the other."""
    x, y = 6.1, 3.1
    corners = np.array([(x, -y), (x, y), (2.0, y), (-2.0, y), (-x, y), (-x, -y), (-2, -y), (2, -y)])
    return rounded_loop(corners + rng.uniform(-0.16, 0.16, corners.shape), radius_m=0.8)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    oak = np.array((168, 132, 92)) * rng.uniform(0.8, 1.08)
    stage.material("planks", floor.parquet(rng, 18, (140, 900), (oak[0], oak[1], oak[2])))
    stage.material("wall", masonry.painted_wall(rng, (512, 1024), (210, 208, 202)))
    hue = HUES[rng.integers(len(HUES))]
    stage.material("accent", masonry.painted_wall(rng, (512, 1024), hue))
    stage.material("paintings", prints.paintings(rng, 15, (280, 380)))
    stage.material("labels", prints.door_signs(rng, 1, 128)[0])
    stage.material("signs", prints.door_signs(rng, 1, 128)[0])
    stage.material("frame_gold", timber.wood(rng, (128, 256), (164, 128, 66)))
    stage.material("frame_black", timber.painted(rng, (128, 128), (44, 42, 42)))
    stage.material("skirting", timber.painted(rng, (128, 256), (196, 194, 188)))
    stage.material("pedestal", masonry.painted_wall(rng, (256, 256), (222, 220, 214)))
    stage.material("bronze", timber.painted(rng, (256, 256), (104, 82, 58)))
    stage.material("marble", prints.marble(rng, 256, (206, 204, 198)))
    stage.material("brass", timber.painted(rng, (128, 128), (172, 142, 84)))
    stage.material("rope", textile.fabric(rng, 64, (120, 34, 38)))
    stage.material("cloth", textile.fabric(rng, 256, HUES[rng.integers(len(HUES))]))
    stage.material("ceiling", masonry.painted_wall(rng, (256, 256), (214, 213, 208)), 0.25)
    stage.material("leaf", timber.wood(rng, (512, 512), (126, 92, 62)))
    stage.material("frame", timber.wood(rng, (128, 256), (112, 80, 54)))
    stage.material("steel", timber.painted(rng, (128, 128), (164, 162, 156)))


def _walls(stage: Stage, rng: np.random.Generator, hung: float) -> None:
    """Build four walls with paintings, one of them in a colour; doors in the short ones."""
    accent = int(rng.integers(4))
    for k, run in enumerate(sides(HALF_M)):
        wall, length = run
        paint = "accent" if k == accent else "wall"
        interior.wall(stage, f"wall_{k}", run, HEIGHT_M, (4.1, HEIGHT_M), paint)
        spots = np.arange(1.3, length - 1.2, 2.15)
        for j, along in enumerate(spots):
            if k % 2 and j == len(spots) // 2:
                interior.door(stage, f"door_{k}", wall, rng, float(along), np.array([0, 0, 1, 1.0]))
            elif rng.random() < hung:
                spot = float(along + rng.uniform(-0.15, 0.15))
                exhibits.painting(stage, f"painting_{k}_{j}", wall, rng, spot)


def _screens(stage: Stage, rng: np.random.Generator) -> None:
    """Stand two walls in the middle with paintings on both sides."""
    _length, thick, high = SCREEN_M
    for k, x in enumerate((-3.4, 3.4)):
        place: Place = (x, 0.0, rng.normal(0, 0.01))
        with stage.object(f"screen_{k}"):
            block = box((0, 0, high / 2), SCREEN_M, (4.1, HEIGHT_M), rng.random(2))
            stage.draw("wall", block.moved((x, 0, 0), place[2]))
        Pen(stage, place, f"screen_{k}").solid(SCREEN_M)
        for side in (0, 1):
            face = local(place, 0.0, (2 * side - 1) * thick / 2, side * np.pi)
            for j, along in enumerate((-0.85, 0.85)):
                exhibits.painting(stage, f"painting_screen_{k}_{side}_{j}", face, rng, along)


def _exhibit(stage: Stage, rng: np.random.Generator, count: int) -> None:
    """Stand sculptures in the corners and in the middle, benches and barriers before paintings."""
    x, y = HALF_M
    corners = [(sx * (x - 0.6), sy * (y - 0.6)) for sx in (-1, 1) for sy in (-1, 1)]
    spots = [(0.0, 0.0), *corners, (-0.7, 1.35), (0.7, -1.35), (0.9, 1.3)]
    for k, (px, py) in enumerate(spots[:count]):
        at_x, at_y = np.array([px, py]) + rng.uniform(-0.08, 0.08, 2)
        exhibits.sculpture(stage, f"sculpture_{k}", (at_x, at_y, rng.uniform(0, 0.6)), rng)
    for k, sign in enumerate((-1, 1)):
        place = (sign * (3.4 + rng.uniform(-0.3, 0.3)), sign * 1.45, rng.normal(0, 0.03))
        exhibits.settee(stage, f"bench_{k}", place, rng)
        start = (-sign * (3.4 + rng.uniform(-0.2, 0.2)) - 1.2, sign * (y - 0.55), 0.0)
        exhibits.barrier(stage, f"barrier_{k}", start, 2.4)


def _ceiling(stage: Stage) -> None:
    """Close the hall, with two tracks of spotlights below."""
    x, y = HALF_M
    interior.ceiling(stage, HALF_M, HEIGHT_M, 1.0, 3.0)
    for across in (-0.62 * y, 0.62 * y):
        track = box((0, across, HEIGHT_M - 0.12), (2 * x - 1, 0.06, 0.05), (0.4, 0.4), bottom=True)
        stage.draw("frame_black", track)
        outward = np.sign(across)
        for along in np.arange(-x + 1.2, x - 1, 1.6):
            top = np.array([along, across, HEIGHT_M - 0.16])
            end = top + np.array([0, 0.1 * outward, -0.2])
            stage.draw("frame_black", tube(top, end, 0.05, 10, 1.2))
