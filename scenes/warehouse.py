"""A warehouse: parallel aisles between pallet racks, on a concrete floor with worn paint."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box, patch
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light, hall_light
from scenes.objects import storage
from scenes.pen import Pen, Place, piece
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import bake_ground, level, quads, tiled
from scenes.structures.interior import collide, sides
from scenes.surfaces import masonry, prints, signs, timber
from scenes.surfaces.atlas import pack
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Aisles that look alike: repeated racks and loads, a smooth floor with painted lines."
TAGS = "indoor level aisles repetitive"
SLAB_M = 3.0
SLAB_PX = 2560
HEIGHT_M = 5.0
PAINT_M = 0.0006
"""Thickness of what is painted on the floor."""


class Options(Settings):
    """Options of the warehouse."""

    aisles: Annotated[int, Field(ge=2, le=8, multiple_of=2)] = 4
    """Number of aisles, even so that a serpentine closes."""
    bays: Annotated[int, Field(ge=2, le=8)] = 3
    """Number of bays of each rack."""
    aisle_m: Annotated[float, Field(ge=1.6, le=3.0)] = 2.0
    """Clear width of the aisles, m."""
    stock: Annotated[float, Field(ge=0, le=1)] = 0.88
    """Share of the places for pallets that are filled."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the warehouse; load, textures and light follow the generator."""
    stage = Stage("warehouse")
    pitch = settings.aisle_m + storage.RACK_DEPTH_M
    length = settings.bays * storage.BAY_M
    half = np.array([length / 2 + 3.1, (settings.aisles * pitch + storage.RACK_DEPTH_M) / 2 + 0.25])
    aisles_y = (np.arange(settings.aisles) - (settings.aisles - 1) / 2) * pitch
    racks_y = (np.arange(settings.aisles + 1) - settings.aisles / 2) * pitch
    light = hall_light(rng, (74, 80))
    _define_materials(stage, rng)
    _stock(stage, rng, racks_y, settings)
    _walls(stage, rng, half)
    _signs(stage, rng, aisles_y, length, settings.aisle_m)
    _place_loose(stage, rng, half, racks_y)
    _floor(stage, rng, half, light)
    return stage.scene(TESTS, TAGS, light, route=_route(rng, aisles_y, length), reach_m=half + 0.2)


def _route(rng: np.random.Generator, aisles_y: Array, length: float) -> Array:
    """Drive through all aisles in turn and back along the wall towards -x."""
    right, left, back = length / 2 + 1.3, -length / 2 - 1.0, -length / 2 - 2.0
    corners: list[tuple[float, float]] = [(back, aisles_y[0]), (right, aisles_y[0])]
    for k, y in enumerate(aisles_y[1:-1]):
        corners += [(right, y), (left, y)] if k % 2 == 0 else [(left, y), (right, y)]
    corners += [(right, aisles_y[-1]), (back, aisles_y[-1])]
    return rounded_loop(np.array(corners) + rng.uniform(-0.05, 0.05, (len(corners), 2)), 0.8)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("floor", pack(masonry.slab(rng, SLAB_PX)[None], 0))
    stage.material("cartons", prints.cartons(rng, 12, 256))
    tones = ((52, 84, 128), (62, 66, 70), (150, 62, 46), (74, 108, 84))
    stage.material("drums", signs.drums(rng, tones, (256, 512)))
    yellow, black = (206, 164, 52), (48, 46, 44)
    stage.material("pine", timber.wood(rng, (256, 1024), (176, 142, 100)))
    stage.material("paint", signs.worn_paint(rng, (256, 1024), yellow, 0.55))
    stage.material("hazard", signs.stripes(rng, (256, 256), (yellow, black), 32))
    stage.material("tags", signs.boards(rng, ["0417"], (48, 112), black, (222, 218, 206))[0])
    stage.material("post", timber.slotted(rng, (512, 128), (60, 84, 122)))
    stage.material("beam", timber.painted(rng, (256, 512), (190, 98, 46)))
    stage.material("steel", timber.painted(rng, (256, 256), (134, 136, 138)))
    stage.material("red", timber.painted(rng, (256, 256), (156, 54, 42)))
    stage.material("dark", timber.painted(rng, (128, 128), (48, 48, 50)))
    stage.material("cone", timber.painted(rng, (128, 128), (204, 92, 44)))
    stage.material("band", timber.painted(rng, (128, 128), (214, 212, 206)))
    stage.material("wall", masonry.plaster(rng, (512, 2048), (190, 190, 184), 0.8))
    stage.material("shutter", signs.shutter(rng, (1024, 1024), (132, 142, 148)))


def _stock(stage: Stage, rng: np.random.Generator, racks_y: Array, settings: Options) -> None:
    """Put up the racks and fill them; each load is an object."""
    for r, y in enumerate(racks_y):
        storage.rack(stage, f"rack_{r}", (0.0, y, 0.0), rng, settings.bays)
        for bay in range(settings.bays):
            for side in (-0.61, 0.61):
                x = (bay - (settings.bays - 1) / 2) * storage.BAY_M + side
                for shelf, base in enumerate(storage.LEVELS_M):
                    if rng.random() > settings.stock:
                        continue
                    turn = np.pi * rng.integers(2) + rng.normal(0, 0.015)
                    place: Place = (x + rng.normal(0, 0.015), y + rng.normal(0, 0.02), turn)
                    with stage.object(f"load_{r}_{bay}_{'a' if side < 0 else 'b'}_{shelf}"):
                        storage.load(stage, rng, place, base)


def _walls(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Close the hall; shutters to -x, posters elsewhere."""
    stage.material("posters", prints.posters(rng, 6, (420, 300)))
    for k, run in enumerate(sides(half)):
        wall, length = run
        put = Pen(stage, wall)
        with stage.object(f"wall_{k}"):
            face = patch((0, 0, 0), (length, 0, 0), (0, 0, HEIGHT_M), (16, 8))
            put("wall", face.textured(np.array([0, 0, length / 8, 1.0])))
            put("dark", box((length / 2, -0.01, 0.07), (length, 0.02, 0.14), (0.5, 0.5)))
            collide(stage, f"wall_{k}", run, HEIGHT_M)
            for along in np.arange(1.2, length - 1, 1.9):
                if k % 2 == 1 and rng.random() < 0.5:
                    sheet = box((along, -0.005, rng.uniform(1.0, 1.4)), (0.6, 0.006, 0.84))
                    put.cell("posters", rng, sheet)
        if k == 3:
            for g, along in enumerate((0.28 * length, 0.72 * length)):
                _shutter(stage, f"shutter_{g}", wall, along)


@piece
def _shutter(put: Pen, along: float) -> None:
    put("shutter", box((along, -0.015, 1.4), (2.6, 0.03, 2.8), (2.6, 2.8)))
    for side in (-1.38, 1.38):
        put("hazard", box((along + side, -0.06, 1.4), (0.14, 0.12, 2.8), (0.5, 0.5)))


def _signs(
    stage: Stage, rng: np.random.Generator, aisles_y: Array, length: float, aisle_m: float
) -> None:
    """Mark each aisle by its name on the floor and on boards at its ends; paint its edges."""
    names = [f"{chr(65 + k // 10)}{k + 1:02d}" for k in range(len(aisles_y))]
    black, yellow = (44, 44, 46), (208, 168, 58)
    plates = signs.boards(rng, names, (160, 256), (226, 224, 214), (44, 78, 118))
    stage.material("plates", plates)
    stage.material("stencils", signs.boards(rng, names, (320, 420), black, yellow, 0.5))
    for k, y in enumerate(aisles_y):
        for end in (-1.0, 1.0):
            with stage.object(f"sign_{k}_{'left' if end < 0 else 'right'}"):
                for side in (-1.0, 1.0):
                    post = (end * (length / 2 + 0.08), y + side * aisle_m / 2, end * np.pi / 2)
                    board = box((0.0, -0.012, 1.25), (0.4, 0.012, 0.25), bottom=True)
                    Pen(stage, post)("plates", board.textured(stage.atlases["plates"].rects[k]))
            with stage.object("floor_paint", Kind.GROUND):
                place: Place = (end * (length / 2 + 0.55), y, end * np.pi / 2)
                mark = patch((-0.32, -0.24, PAINT_M), (0.64, 0, 0), (0, 0.48, 0), (3, 3))
                Pen(stage, place)("stencils", mark.textured(stage.atlases["stencils"].rects[k]))
        with stage.object("floor_paint", Kind.GROUND):
            for side in (-1.0, 1.0):
                low = (-length / 2 - 0.1, y + side * (aisle_m / 2 - 0.13) - 0.04, PAINT_M)
                line = patch(low, (length + 0.2, 0, 0), (0, 0.08, 0), (30, 1), (1.0, 0.25))
                stage.draw("paint", line)


def _place_loose(stage: Stage, rng: np.random.Generator, half: Array, racks_y: Array) -> None:
    """Place trucks, drums and cones at the ends of the racks and along the walls."""
    for k, y in enumerate(racks_y[1:-1:2]):
        spot: Place = (half[0] - 0.72, y + rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2))
        if k % 2 == 0:
            storage.pallet_truck(stage, f"truck_{k}", spot, rng)
        else:
            storage.standing_drums(stage, f"drum_{k}", rng, np.array(spot[:2]))
    for k, side in enumerate((-1, 1)):
        corner = half * (1, side) - np.array([0.75, 0.75 * side])
        storage.standing_drums(stage, f"corner_{k}", rng, corner)
    for k, y in enumerate(racks_y[1:-1]):
        place = (-half[0] + 0.35, y + rng.uniform(-0.5, 0.5), rng.uniform(0, 1))
        storage.cone(stage, f"cone_{k}", place)


def _floor(stage: Stage, rng: np.random.Generator, half: Array, light: Light) -> None:
    """Lay slabs of 3 m with sawn joints, alike but for their turn."""
    cells = np.ceil(half / SLAB_M) * SLAB_M
    corners = quads(-cells, cells, 0.25)
    inside = (np.abs(corners.mean(axis=1)) < half + 0.1).all(axis=1)
    corners = corners[inside]
    ground = bake_ground(stage, light, half, (rng, 0.2))
    with stage.object("floor", Kind.GROUND):
        ground.draw("floor", level(corners, tiled(rng, corners, SLAB_M, stage.atlases["floor"])))
