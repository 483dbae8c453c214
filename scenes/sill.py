"""Six rooms in a ring, with sills in the doorways and cables and rugs between them."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import Mesh, box
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import Light, hall_light
from scenes.objects import furniture
from scenes.pen import Pen, Place, local
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures import interior
from scenes.structures.ground import bake_ground, coursed, level, quads, tiled
from scenes.structures.interior import WALL_M, sides
from scenes.structures.thresholds import bridged_cable, cable, rug, sill
from scenes.surfaces import floor, greenery, masonry, prints, signs, sky, textile, timber
from scenes.surfaces.atlas import Atlas
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Door sills, cable ramps and rugs across the route: each of them is a short, hard jolt."
TAGS = "indoor bumpy rooms textured"
HALF_M = np.array([9.0, 5.6])
WALLS_X_M = (-3.0, 3.0)
LANE_M = np.array([6.0, 2.8])
"""Half sizes of the route's rectangle; it passes the middle of every doorway."""
DOOR_M = 1.2
DOOR_HEIGHT_M = 2.1
HEIGHT_M = 2.6
SILL_WIDTH_M = 0.16
TILE_M = {"carpet": 0.5, "felt": 0.5, "stone": 0.3, "terrazzo": 0.4}
PIECES = {"books": 0.45, "cabinet": 0.2, "cartons": 0.2, "plant": 0.15}
"""Share of each kind of piece along the walls."""


class Options(Settings):
    """Options of the rooms."""

    sill_mm: Annotated[float, Field(gt=0, le=12)] = 8.0
    """Height of the highest sill, mm; the lowest has five eighths of it."""
    ramp_mm: Annotated[float, Field(gt=0, le=10)] = 6.0
    """Height of the cable ramps, mm."""
    cable_mm: Annotated[float, Field(gt=0, le=8)] = 5.0
    """Thickness of cables that lie bare, mm."""
    rug_mm: Annotated[float, Field(gt=0, le=8)] = 4.0
    """Thickness of the rugs, mm."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the rooms; layout, textures and light follow the generator."""
    stage = Stage("sill")
    light = hall_light(rng, (70, 78))
    _define_materials(stage, rng)
    _outer_walls(stage, rng)
    _partitions(stage)
    _furnish(stage, rng)
    _thresholds(stage, rng, settings)
    _floors(stage, rng, light)
    return stage.scene(TESTS, TAGS, light, route=_route(), reach_m=HALF_M + 0.2)


def _route() -> Array:
    """Go through all rooms, straight through each doorway, with a jog in the middle rooms."""
    x, y = LANE_M
    corners = [(x, -y), (x, y)]
    corners += [(1.7, y), (0.8, y + 0.5), (-0.8, y + 0.5), (-1.7, y)]
    corners += [(-x, y), (-x, -y)]
    corners += [(-1.7, -y), (-0.8, -y - 0.5), (0.8, -y - 0.5), (1.7, -y)]
    return rounded_loop(np.array(corners), radius_m=0.9)


def _doorways() -> list[Place]:
    """List the middles of the doorways; x runs along the wall."""
    x, y = LANE_M
    across = [(wall, side * y, np.pi / 2) for wall in WALLS_X_M for side in (-1, 1)]
    return [*across, (-x, 0.0, 0.0), (x, 0.0, 0.0)]


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("oak_planks", floor.parquet(rng, 24, (90, 900), (164, 126, 86)))
    stage.material("dark_planks", floor.parquet(rng, 16, (140, 900), (122, 92, 66)))
    stage.material("carpet", textile.carpet_tiles(rng, 8, 500))
    stage.material("felt", textile.carpet_tiles(rng, 8, 500))
    stage.material("terrazzo", masonry.terrazzo_tiles(rng, 8, 400))
    stage.material("stone", floor.paving_slabs(rng, 20, 300))
    stage.material("rugs", textile.rugs(rng, 3, (600, 900)))
    stage.material("posters", prints.posters(rng, 8, (420, 300)))
    stage.material("books", prints.book_rows(rng, 8, (192, 672)))
    stage.material("cartons", prints.cartons(rng, 6, 256))
    stage.material("screens", prints.screens(rng, 4, (200, 340)), 0.4)
    paints = ((214, 211, 202), (196, 204, 206), (216, 202, 184), (200, 206, 190))
    stage.material("wall", masonry.plaster(rng, (512, 2048), paints[rng.integers(4)], 0.3))
    stage.material("oak", timber.wood(rng, (512, 1024), (142, 106, 72)))
    stage.material("beech", timber.wood(rng, (512, 1024), (190, 158, 118)))
    stage.material("sill", timber.wood(rng, (256, 1024), (104, 78, 56)))
    stage.material("steel", timber.painted(rng, (256, 256), (150, 152, 154)))
    stage.material("panel", timber.painted(rng, (512, 512), (182, 182, 178)))
    stage.material("drawer", timber.painted(rng, (512, 512), (120, 134, 142)))
    stage.material("plastic", timber.painted(rng, (256, 256), (56, 58, 62)))
    stage.material("rubber", timber.painted(rng, (256, 256), (58, 58, 60)))
    stage.material("cable", timber.painted(rng, (64, 64), (52, 52, 56)))
    stage.material("hazard", signs.stripes(rng, (256, 256), ((206, 164, 52), (48, 46, 44)), 32))
    stage.material("rug_edge", textile.fabric(rng, 128, (96, 62, 54)))
    stage.material("cloth", textile.fabric(rng, 256, (76, 92, 108)))
    stage.material("pot", timber.painted(rng, (256, 256), (150, 104, 80)))
    stage.material("soil", greenery.soil(rng, 256))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("keyboard", prints.keyboard())
    stage.material("notes", prints.notes(rng, (480, 500)))
    stage.material("label", prints.posters(rng, 1, (64, 128))[0])
    stage.material("glass", sky.window_view(rng, (128, 192)), 0.5)


def _outer_walls(stage: Stage, rng: np.random.Generator) -> None:
    """Close the house: windows to the north and south, pictures to the east and west."""
    for k, run in enumerate(sides(HALF_M)):
        wall, length = run
        put = Pen(stage, wall)
        interior.wall(stage, f"wall_{k}", run, HEIGHT_M, (8.0, HEIGHT_M), board="oak")
        with stage.object(f"{'windows' if k % 2 == 0 else 'pictures'}_{k}"):
            for along in np.arange(1.5, length - 1.0, 1.5):
                if k % 2 == 0 and min(abs(along - length / 2 - x) for x in WALLS_X_M) > 0.8:
                    put("glass", box((along, -0.008, 1.65), (1.1, 0.012, 1.2)))
                    for dx in (-0.56, 0.56):
                        put("panel", box((along + dx, -0.02, 1.65), (0.05, 0.04, 1.26)))
                    for z in (1.04, 2.26):
                        put("panel", box((along, -0.022, z), (1.17, 0.05, 0.05), bottom=True))
                elif k % 2 == 1 and rng.random() < 0.6:
                    sheet = box((along, -0.006, rng.uniform(1.2, 1.5)), (0.6, 0.008, 0.84))
                    put.cell("posters", rng, sheet)


def _partitions(stage: Stage) -> None:
    """Stand the inner walls, open at the doorways, and frame these."""
    x, y = HALF_M
    runs = [((wall, -y, np.pi / 2), 2 * y, (y - LANE_M[1], y + LANE_M[1])) for wall in WALLS_X_M]
    runs.append(((-x, 0.0, 0.0), 2 * x, (x - LANE_M[0], x + LANE_M[0])))
    for k, (wall, length, doors) in enumerate(runs):
        put = Pen(stage, wall)
        edges = [0.0, *(d + side * DOOR_M / 2 for d in doors for side in (-1, 1)), length]
        with stage.object(f"partition_{k}"):
            for start, end in zip(edges[::2], edges[1::2], strict=True):
                middle, long = (start + end) / 2, end - start
                block = box((middle, 0, HEIGHT_M / 2), (long, WALL_M, HEIGHT_M), (8.0, HEIGHT_M))
                put("wall", block)
                put("oak", box((middle, 0, 0.05), (long - 0.02, WALL_M + 0.024, 0.1), (1.2, 0.6)))
            for door in doors:
                high = HEIGHT_M - DOOR_HEIGHT_M
                lintel = (door, 0, HEIGHT_M - high / 2)
                put("wall", box(lintel, (DOOR_M, WALL_M, high), (8.0, HEIGHT_M), bottom=True))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            size, middle = (end - start, WALL_M, HEIGHT_M), (start + end) / 2
            Pen(stage, wall, f"partition_{k}_{start:.0f}").solid(size, (middle, 0.0))
        for door in doors:
            with stage.object(f"frame_{k}_{door:.0f}"):
                for side in (-1, 1):
                    jamb = (door + side * (DOOR_M / 2 - 0.015), 0, DOOR_HEIGHT_M / 2)
                    put("oak", box(jamb, (0.03, WALL_M + 0.05, DOOR_HEIGHT_M), (0.6, 1.2)))
                head = (door, 0, DOOR_HEIGHT_M - 0.015)
                put("oak", box(head, (DOOR_M, WALL_M + 0.05, 0.03), (1.2, 0.6), bottom=True))


def _thresholds(stage: Stage, rng: np.random.Generator, settings: Options) -> None:
    """Lay a sill in each doorway, and ramps, cables and rugs between them."""
    for k, place in enumerate(_doorways()):
        height = 1e-3 * settings.sill_mm * rng.uniform(0.625, 1.0)
        size = np.array([DOOR_M - 0.06, SILL_WIDTH_M, height])
        sill(stage, f"sill_{k}", rng, place, size, 0.014)
    x, y = LANE_M
    ramp = np.array([1.5, 0.11, 1e-3 * settings.ramp_mm])
    reach = HALF_M[1] - y - ramp[0] / 2 - 0.02
    for k, px in enumerate((-4.5, 4.4)):
        place = (px + rng.uniform(-0.3, 0.3), (-1) ** (k + 1) * y, np.pi / 2)
        inward = y - ramp[0] / 2 - 0.1
        beyond = (reach, inward) if k == 0 else (inward, reach)
        bridged_cable(stage, f"lead_{k}", place, ramp, 0.02, beyond)
    place = (0.0 + rng.uniform(-0.3, 0.3), -y - 0.5, np.pi / 2)
    bridged_cable(stage, "lead_2", place, ramp, 0.02, (reach - 0.5, y - ramp[0] / 2 + 0.3))
    for k, (px, py) in enumerate(((x, 1.3), (-x, -1.25))):
        along = rng.uniform(-0.15, 0.15, 7)
        bends = np.column_stack([px + np.linspace(-2.2, 2.2, 7), py + along])
        cable(stage, f"cable_{k}", bends, 0.5e-3 * settings.cable_mm)
    for k, (px, py, turn) in enumerate(((0.1, y + 0.4, 0.0), (-5.0, y, 0.0), (4.7, -y, 0.0))):
        size = np.array([*rng.uniform((1.5, 1.1), (1.9, 1.3)), 1e-3 * settings.rug_mm])
        spot = (px + rng.uniform(-0.1, 0.1), py, turn + rng.uniform(-0.15, 0.15))
        rug(stage, f"rug_{k}", rng, spot, size)


def _furnish(stage: Stage, rng: np.random.Generator) -> None:
    """Line each room's outer wall; put a desk, or cartons and a plant, at its inner corners."""
    number = 0
    for k, (wall, length) in enumerate(sides(HALF_M)):
        for along in np.arange(0.8, length - 0.7, 1.15):
            near = [abs(along - length / 2 - p) for p in (WALLS_X_M if k % 2 == 0 else (0.0,))]
            if min(near) > 0.75 and rng.random() < 0.8:
                kind = str(rng.choice(list(PIECES), p=list(PIECES.values())))
                spot = local(wall, float(along), 0.0)
                furniture.against_wall(stage, f"piece_{number}", rng, spot, kind)
                number += 1
    for k, (px, py) in enumerate(((-1.2, 0.5), (1.2, -0.5), (-8.0, 0.55), (8.0, -0.55))):
        place: Place = (px, py, np.pi if py > 0 else 0.0)
        furniture.desk(stage, f"desk_{k}", place, rng)
        seat = local(place, rng.uniform(-0.2, 0.2), -0.5, np.pi + rng.uniform(-0.5, 0.5))
        furniture.chair(stage, f"chair_{k}", seat, rng)
        beside = 0.9 if abs(px) < 2 else -0.9 * np.sign(px)
        furniture.bin_(stage, f"bin_{k}", local(place, beside, 0.1))


def _floors(stage: Stage, rng: np.random.Generator, light: Light) -> None:
    """Give each of the six rooms a floor of its own."""
    x, y = HALF_M
    ground = bake_ground(stage, light, HALF_M)
    columns = (-x, *WALLS_X_M, x)
    kinds = rng.permutation(["oak_planks", "dark_planks", "carpet", "felt", "stone", "terrazzo"])
    for k, kind in enumerate(kinds):
        low, high = columns[k % 3], columns[k % 3 + 1]
        south, north = (-y, 0.0) if k < 3 else (0.0, y)
        ends = np.array([(low, south), (high, north)])
        with stage.object(f"floor_{k}", Kind.GROUND):
            ground.draw(str(kind), _laid(rng, str(kind), ends, stage.atlases[str(kind)]))


def _laid(rng: np.random.Generator, kind: str, ends: Array, atlas: Atlas) -> Mesh:
    """Cover the rectangle between (2, 2) corners with planks or tiles."""
    low, high = ends
    if kind.endswith("planks"):
        width = 0.09 if kind.startswith("oak") else 0.14
        half = (high - low) / 2
        rows = np.array([half[0], np.floor(half[1] / width) * width])
        planks = coursed(rng, rows, half[1] * width / rows[1], (0.7, 0.95), atlas, 4)
        return planks.moved((*(low + high) / 2, 0.0))
    tile = TILE_M[kind]
    corners = quads(low, high, tile / 2)
    return level(corners, tiled(rng, corners - low, tile, atlas))
