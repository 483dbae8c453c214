"""An open-plan office: carpet tiles, desks in islands, shelves and clutter along the walls."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import Mesh, box, merged, patch
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light, lamp
from scenes.objects import furniture
from scenes.pen import Pen, Place, local, piece
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.ground import bake_ground
from scenes.structures.interior import collide, sides
from scenes.surfaces import greenery, masonry, prints, sky, textile, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "An indoor carpet of fine, low-contrast texture: a smooth, level drive between desks."
TAGS = "indoor level textured"
TILE_M = 0.5
ROOM_HEIGHT_M = 2.7


class Options(Settings):
    """Options of the office."""

    length_m: Annotated[float, Field(ge=12, le=20)] = 13.0
    """Size of the room along x, m."""
    width_m: Annotated[float, Field(ge=8.5, le=14)] = 9.0
    """Size of the room along y, m."""
    clutter: Annotated[float, Field(ge=0, le=1)] = 0.85
    """Share of the places along the walls that are filled."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the office; layout, textures and light follow the generator."""
    stage = Stage("office")
    half = np.array([settings.length_m, settings.width_m]) / 2
    _define_materials(stage, rng)
    light = _lamps(rng)
    with stage.object("walls"):
        _walls(stage, rng, half)
    _islands(stage, rng, half)
    _along_walls(stage, rng, half, settings.clutter)
    with stage.object("carpet", Kind.GROUND):
        _carpet(stage, rng, half, light)
    return stage.scene(TESTS, TAGS, light, route=_route(rng, half), reach_m=half + 0.2)


def _route(rng: np.random.Generator, half: Array) -> Array:
    """Drive once around the islands, counter-clockwise."""
    x, y = half - 1.25
    corners = np.array([
        (x, -y + rng.uniform(0, 0.12)), (x - rng.uniform(0, 0.12), y),
        (0.3 * x, y - rng.uniform(0, 0.1)), (-0.3 * x, y), (-x, y - rng.uniform(0, 0.12)),
        (-x + rng.uniform(0, 0.12), -y), (-0.3 * x, -y + rng.uniform(0, 0.1)), (0.3 * x, -y),
    ])  # fmt: skip
    return rounded_loop(corners, radius_m=0.8)


def _lamps(rng: np.random.Generator) -> Light:
    """Build daylight from windows in the wall towards +y, and ceiling panels as the fill."""
    return lamp(
        (np.pi / 2 + rng.uniform(-0.5, 0.5), rng.uniform(50, 60)),
        on_ground=(0.29, 0.295, 0.30),  # all lamps together light the floor by about 1
        fill=(0.38, 0.372, 0.36),
        ambient=(0.33, 0.328, 0.325),
        softness_rad=0.45,
    )


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("posters", prints.posters(rng, 10, (420, 300)))
    stage.material("books", prints.book_rows(rng, 14, (192, 672)))
    stage.material("cartons", prints.cartons(rng, 8, 256))
    stage.material("screens", prints.screens(rng, 6, (200, 340)), 0.4)
    stage.material("wall", masonry.plaster(rng, (512, 2048), (214, 211, 202), 0.3))
    stage.material("beech", timber.wood(rng, (512, 1024), (190, 158, 118)))
    stage.material("oak", timber.wood(rng, (512, 1024), (142, 106, 72)))
    stage.material("steel", timber.painted(rng, (256, 256), (150, 152, 154)))
    stage.material("panel", timber.painted(rng, (512, 512), (182, 182, 178)))
    drawer = (172, 174, 174) if rng.random() < 0.5 else (120, 134, 142)
    stage.material("drawer", timber.painted(rng, (512, 512), drawer))
    stage.material("plastic", timber.painted(rng, (256, 256), (56, 58, 62)))
    stage.material("pot", timber.painted(rng, (256, 256), (150, 104, 80)))
    seat = np.array(((66, 84, 108), (112, 70, 62), (76, 92, 78)))[rng.integers(3)]
    stage.material("cloth", textile.fabric(rng, 256, (seat[0], seat[1], seat[2])))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("soil", greenery.soil(rng, 256))
    stage.material("notes", prints.notes(rng, (480, 500)))
    stage.material("keyboard", prints.keyboard())
    stage.material("glass", sky.window_view(rng, (128, 192)), 0.5)
    stage.material("label", prints.posters(rng, 1, (64, 128))[0])


def _walls(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Build four walls with skirting; posters, a door to -x and windows to +y."""
    x, y = half
    for k, (wall, length) in enumerate(sides(half)):
        put = Pen(stage, wall)
        inside = patch((0, 0, 0), (length, 0, 0), (0, 0, ROOM_HEIGHT_M), (24, 9))
        put("wall", inside.textured(np.array([0, 0, length / 8, 1.0])))
        put("oak", box((length / 2, -0.008, 0.05), (length - 0.04, 0.016, 0.1), (1.2, 0.6)))
        collide(stage, f"wall_{k}", (wall, length), ROOM_HEIGHT_M)
        for place in np.arange(0.8, length - 1.2, 1.15):
            if rng.random() < 0.5 and not (k == 0 or (k == 3 and abs(place - y) < 1.5)):
                low = rng.uniform(0.55, 1.2)
                sheet = box((place + 0.25, -0.004, low + 0.42), (0.6, 0.006, 0.84))
                put.cell("posters", rng, sheet)
    _door(stage, "door", (-x, -y, np.pi / 2), rng, y)
    _windows(stage, "windows", (-x, y, 0.0), 2 * x)


@piece
def _windows(put: Pen, length_m: float) -> None:
    """Glaze a wall from 0.95 m up, in bays of 2.4 m."""
    for middle in np.arange(1.5, length_m - 1.2, 2.4):
        put("glass", box((middle, -0.006, 1.65), (1.9, 0.008, 1.36)))
        for dx in (-0.95, 0.0, 0.95):
            put("panel", box((middle + dx, -0.02, 1.65), (0.06, 0.04, 1.42), (1.0, 1.0)))
        for dz in (-0.71, 0.71):
            put("panel", box((middle, -0.022, 1.65 + dz), (1.96, 0.05, 0.06), (1.0, 1.0)))


@piece
def _door(put: Pen, rng: np.random.Generator, along_m: float) -> None:
    put("oak", box((along_m, -0.012, 1.03), (0.92, 0.02, 2.06), (1.2, 2.2), rng.random(2)))
    for side in (-0.5, 0.5):
        put("steel", box((along_m + side, -0.02, 1.06), (0.08, 0.04, 2.12), (0.5, 0.5)))
    put("steel", box((along_m + 0.36, -0.05, 1.02), (0.13, 0.02, 0.02), (0.5, 0.5), bottom=True))
    put("steel", box((along_m, -0.024, 0.18), (0.84, 0.003, 0.24), (0.5, 0.5)))


def _islands(stage: Stage, rng: np.random.Generator, half: Array) -> None:
    """Place three islands of four desks, back to back, with a chair and clutter at each."""
    pitch = (2 * half[0] - 2 * 2.0) / 3
    for k in range(3):
        centre: Place = ((k - 1) * pitch, 0.0, np.pi / 2 + rng.normal(0, 0.01))
        for j, (dx, side) in enumerate(((-0.81, 1), (0.81, 1), (-0.81, -1), (0.81, -1))):
            place = local(centre, dx, side * 0.42, 0.0 if side < 0 else np.pi)
            number = 4 * k + j
            furniture.desk(stage, f"desk_{number}", place, rng)
            seat = local(place, rng.uniform(-0.2, 0.2), rng.uniform(-0.62, -0.5), np.pi)
            turned = (seat[0], seat[1], seat[2] + rng.uniform(-0.6, 0.6))
            furniture.chair(stage, f"chair_{number}", turned, rng)
            if rng.random() < 0.6:
                spot = local(place, rng.uniform(0.35, 0.55) * rng.choice([-1, 1]), -0.55)
                furniture.bin_(stage, f"bin_{number}", spot)


def _along_walls(stage: Stage, rng: np.random.Generator, half: Array, clutter: float) -> None:
    """Line the walls, 0.45 m deep, with bookcases, cabinets, boxes, plants and a whiteboard."""
    number = 0
    for k, (wall, length) in enumerate(sides(half)):
        for along in np.arange(0.75, length - 0.7, 1.12):
            blocked = k == 3 and abs(along - half[1]) < 1.1  # the door
            if blocked or rng.random() > clutter:
                continue
            _piece(stage, f"piece_{number}", rng, local(wall, float(along), 0.0))
            number += 1


def _piece(stage: Stage, name: str, rng: np.random.Generator, wall: Place) -> None:
    """Stand one random piece against the wall at a place on it."""
    kinds = ["books", "cabinet", "cartons", "plant", "board"]
    kind = rng.choice(kinds, p=[0.42, 0.2, 0.18, 0.13, 0.07])
    if kind == "board":
        furniture.whiteboard(stage, name, local(wall, 0, -0.56, rng.uniform(-0.05, 0.05)))
    else:
        furniture.against_wall(stage, name, rng, wall, str(kind), plant_m=0.25)


def _carpet(stage: Stage, rng: np.random.Generator, half: Array, light: Light) -> None:
    """Lay carpet tiles, each of a random variant and turn, in the baked light of the room."""
    stage.material("carpet", textile.carpet_tiles(rng, 16, 500))
    counts = np.ceil(2 * half / TILE_M).astype(int)
    tiles: list[Mesh] = []
    for i, j in np.ndindex(*counts):
        corner = (i * TILE_M - half[0], j * TILE_M - half[1], 0.0)
        tile = patch(corner, (TILE_M, 0, 0), (0, TILE_M, 0), (5, 5))
        turn = int(rng.integers(8))  # one of 8 turns and mirror images
        uv = tile.uv[:, ::-1] if turn & 1 else tile.uv
        flips = np.array([turn >> 1 & 1, turn >> 2 & 1])
        tile = replace(tile, uv=flips + uv * (1 - 2 * flips))
        tiles.append(tile.textured(stage.pick("carpet", rng)))
    bake_ground(stage, light, half).draw("carpet", merged(tiles))
