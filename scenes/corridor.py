"""An office corridor that runs around a core: painted walls, plain flooring, a row of doors."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light
from scenes.lighting.lamps import Lamplight
from scenes.objects.props import potted_plant
from scenes.pen import Pen, local, piece
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures import interior
from scenes.structures.ground import level, quads, scattered
from scenes.structures.interior import Run, sides
from scenes.surfaces import floor, greenery, masonry, prints, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Blank walls and plain flooring: few features, far apart, and long views down the corridor."
TAGS = "indoor level plain"
HEIGHT_M = 2.5
PERIOD_M = (3.1, 2.9)
"""Size of the walls' texture."""
PANEL_POWER = 6.0
"""As `Lamplight.powers`."""
FLOORS = ((146, 150, 142), (158, 146, 126), (124, 136, 148), (150, 152, 154))
LEAVES = ((96, 118, 138), (162, 126, 88), (120, 132, 112), (176, 174, 168))


class Options(Settings):
    """Options of the corridor."""

    length_m: Annotated[float, Field(ge=13, le=30)] = 14.5
    """Length of the long arms, between the outer walls, m."""
    width_m: Annotated[float, Field(ge=7, le=20)] = 7.8
    """Length of the short arms, between the outer walls, m."""
    arm_m: Annotated[float, Field(ge=1.7, le=2.6)] = 2.0
    """Width of the corridor, m."""
    doors: Annotated[float, Field(ge=0, le=1)] = 0.8
    """Share of the places for doors that have one."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the corridor; colours, doors and what hangs on the walls follow the generator."""
    stage = Stage("corridor")
    half = np.array([settings.length_m, settings.width_m]) / 2
    core = half - settings.arm_m
    middle = half - settings.arm_m / 2
    panels = _panel_places(middle)
    _define_materials(stage, rng)
    with stage.object("floor", Kind.GROUND):
        _floor(stage, rng, half, core)
    _walls(stage, half, core)
    with stage.object("ceiling"):
        interior.ceiling(stage, half, HEIGHT_M, 0.5, 2.0)
        for panel in panels:
            interior.ceiling_panel(stage, panel, (0.6, 0.6))
    for k, run in enumerate((*sides(half), *interior.around(core))):
        _furnish(stage, f"{k}", rng, run, settings.doors)
    for k, (x, y, yaw) in enumerate(((-core[0], middle[1], 0.0), (core[0], -middle[1], np.pi))):
        sign = stage.atlases["signs_lit"].rects[0]
        interior.exit_sign(stage, f"exit_{k}", (x, y, yaw + np.pi / 2), HEIGHT_M, sign)
    _fill_corners(stage, rng, half)
    light = _lamps(rng)
    lamps = Lamplight(panels, np.full(len(panels), PANEL_POWER), stage.occluders, light)
    route = rounded_loop(_corners(middle), radius_m=0.65)
    return stage.scene(TESTS, TAGS, light, lamps=lamps, route=route, reach_m=half + 0.15)


def _corners(middle: Array) -> Array:
    """List the corners of the route, counter-clockwise."""
    return np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)]) * middle


def _panel_places(middle: Array) -> Array:
    """Place a ceiling panel at every corner and about every 2.4 m between: (P, 3) metres."""
    places: list[Array] = []
    corners = _corners(middle)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(2, round(float(np.linalg.norm(end - start)) / 2.4))
        places.extend(start + share * (end - start) for share in np.arange(count) / count)
    return np.column_stack([places, np.full(len(places), HEIGHT_M)])


def _lamps(rng: np.random.Generator) -> Light:
    """Give the panels' colour as the key's; a good part comes back from walls and floor."""
    turn = rng.uniform(0, 2 * np.pi)
    tint = np.array([1.0, 0.99, 0.955]) * rng.uniform(0.96, 1.0, 3)
    return Light(
        key=np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), np.sqrt(0.75)]),
        key_rgb=0.62 * tint,
        fill_rgb=0.2 * tint,
        ambient_rgb=0.29 * tint,
    )


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    symbols = prints.pictograms(160)
    posters = prints.posters(rng, 8, (280, 200))
    plates = np.concatenate([prints.door_signs(rng, 14, 160), symbols[:1]])
    stage.material("floor", floor.linoleum(rng, 2048, FLOORS[rng.integers(len(FLOORS))]))
    tint = np.array((214, 212, 204)) * rng.uniform(0.96, 1.02, 3)
    stage.material("wall", masonry.painted_wall(rng, (1024, 1024), (tint[0], tint[1], tint[2])))
    stage.material("posters", posters)
    stage.material("signs", plates)
    stage.material("signs_lit", symbols[1:], 0.5)
    leaf = np.array(LEAVES[rng.integers(len(LEAVES))])
    stage.material("leaf", masonry.painted_wall(rng, (512, 512), (leaf[0], leaf[1], leaf[2])), 0.12)
    stage.material("frame", timber.painted(rng, (256, 256), (116, 120, 124)), 0.1)
    stage.material("skirting", timber.painted(rng, (256, 512), (92, 96, 98)), 0.1)
    stage.material("steel", timber.painted(rng, (256, 256), (160, 162, 164)), 0.1)
    stage.material("radiator", masonry.painted_wall(rng, (256, 256), (206, 206, 200)), 0.05)
    stage.material("red", timber.painted(rng, (128, 128), (176, 36, 30)), 0.1)
    stage.material("plastic", timber.painted(rng, (128, 128), (50, 52, 56)))
    stage.material("label", prints.posters(rng, 1, (128, 96))[0])
    stage.material("cork", greenery.soil(rng, 256) // 2 + np.array([92, 66, 40], np.uint8), 0.1)
    stage.material("ceiling", masonry.painted_wall(rng, (512, 512), (218, 217, 212)), 0.3)
    stage.material("panel", timber.painted(rng, (128, 128), (170, 172, 172)), 0.2)
    stage.material("lamp", np.full((8, 8, 3), (244, 244, 238), np.uint8), 0.7)
    stage.material("pot", timber.painted(rng, (128, 128), (96, 98, 100)))
    stage.material("soil", greenery.soil(rng, 128))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])


def _floor(stage: Stage, rng: np.random.Generator, half: Array, core: Array) -> None:
    """Unroll flooring in sheets of 2 m on the four arms."""
    (x, y), (cx, cy) = half, core
    arms = (((-x, -y), (x, -cy)), ((-x, cy), (x, y)), ((-x, -cy), (-cx, cy)), ((cx, -cy), (x, cy)))
    corners = np.concatenate([quads(low, high, 0.25) for low, high in arms])
    stage.draw("floor", level(corners, scattered(rng, corners, 2.0, 2.048)))


def _walls(stage: Stage, half: Array, core: Array) -> None:
    """Build the outer walls and the core."""
    for k, run in enumerate(sides(half)):
        interior.wall(stage, f"wall_{k}", run, HEIGHT_M, PERIOD_M)
    with stage.object("core"):
        for run in interior.around(core):
            stage.draw("wall", interior.wall_face(run, HEIGHT_M, PERIOD_M))
            stage.draw("skirting", interior.skirting(run))
    stage.obstacle("core", (0, 0, HEIGHT_M / 2), (*2 * core, HEIGHT_M))


def _furnish(stage: Stage, name: str, rng: np.random.Generator, run: Run, doors: float) -> None:
    """Hang doors on a wall, and between them here and there a board or an extinguisher."""
    wall, length = run
    signs = stage.atlases["signs"].rects
    pitch = length / max(1, round(length / 2.9))
    margin = 1.1
    for k, along in enumerate(np.arange(pitch / 2, length, pitch)):
        spot = float(along + rng.uniform(-0.35, 0.35))
        if not margin < spot < length - margin:
            continue
        if rng.random() < doors:
            sign = signs[rng.integers(len(signs) - 1)]
            interior.door(stage, f"door_{name}_{k}", wall, rng, spot, sign)
            _switch(stage, f"switch_{name}_{k}", wall, spot + 0.72)
        beside = float(along + pitch / 2 + rng.uniform(-0.1, 0.1))
        if beside > length - margin or pitch < 2.4:
            continue
        draw = rng.random()
        if draw < 0.22:
            interior.notice_board(stage, f"board_{name}_{k}", wall, rng, beside)
        elif draw < 0.45:
            interior.extinguisher(stage, f"extinguisher_{name}_{k}", wall, beside, signs[-1])


def _fill_corners(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Stand a plant in two of the outer corners, hang a radiator beside the others."""
    for k, (wall, length) in enumerate(sides(half)):
        if k % 2:
            x, y, _ = local(wall, 0.44, -0.44)
            potted_plant(stage, f"plant_{k}", rng, (x, y))
        else:
            interior.radiator(stage, f"radiator_{k}", wall, 0.75 + rng.uniform(0, 0.2))
        for j, along in enumerate((0.9, length - 0.9)):
            spot = along + 0.5 * (1 - 2 * j) + rng.uniform(-0.1, 0.1)
            _switch(stage, f"switch_corner_{k}_{j}", wall, spot)


@piece
def _switch(put: Pen, along_m: float) -> None:
    """Put a light switch at 1.05 m and a socket at 0.3 m on a wall."""
    for z in (0.3, 1.05):
        put("panel", box((along_m, -0.006, z), (0.08, 0.012, 0.08)))
        put("frame", box((along_m, -0.013, z), (0.05, 0.004, 0.05)))
