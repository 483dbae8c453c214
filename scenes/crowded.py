"""A station hall full of people: figures, trolleys and carriers cross the rover's view."""

from typing import Annotated

import numpy as np
from pydantic import Field

from scenes.geometry.mesh import box, patch, tube
from scenes.geometry.routes import rounded_loop
from scenes.lighting.baked_light import hall_light
from scenes.objects import people
from scenes.objects.furniture import bin_, cabinet
from scenes.objects.people import Crossing, Lap, Walk
from scenes.objects.props import bench, planter, potted_plant
from scenes.pen import Pen, Place, local, one_object, piece
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures import interior
from scenes.structures.ground import bake_ground, level, quads, tiled
from scenes.structures.interior import sides
from scenes.surfaces import greenery, masonry, prints, signs, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "Pedestrians and trolleys cover up to a third of the view: moving points must be rejected."
TAGS = "indoor level dynamic textured"
HALF_M = np.array([9.4, 7.2])
ROUTE_M = np.array([5.3, 3.3])
"""Half sizes of the route's rectangle."""
LANES_M = (-0.95, -1.55, -2.15, 0.95, 1.6, 2.2)
"""Distance of each lane of pedestrians outside the route; figures are half a metre wide."""
OVERTAKING = 3
"""Lane beside the route whose pedestrians pass the rover slowly and fill much of its view."""
PORTER = 0.62
"""Lead of carriers and porters over the first pedestrian of a lane, as a share of its length."""
TILE_M = 0.6
HEIGHT_M = 4.5
ROVER_MPS = 0.3
ROVER_STARTS_S = 1.5
LAPS = 12
"""Number of the rover's laps for which crossings are planned."""


class Options(Settings):
    """Options of the hall."""

    walkers: Annotated[int, Field(ge=0, le=18)] = 9
    """Number of pedestrians in lanes beside the route."""
    crossers: Annotated[int, Field(ge=0, le=6)] = 3
    """Number of pedestrians that cross the route a few metres ahead of a rover that drives the
    default route at 0.3 m/s; use 0 for another drive, or they may hit it."""
    pace: Annotated[float, Field(gt=0, le=2)] = 1.0
    """Factor on the speed of all movers."""


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the hall; layout, textures, light and walks follow the generator."""
    stage = Stage("crowded")
    light = hall_light(rng, (76, 82))
    _define_materials(stage, rng)
    _walls(stage, rng)
    _columns(stage)
    _furnish(stage, rng)
    with stage.object("floor", Kind.GROUND):
        corners = quads((-16 * TILE_M, -12 * TILE_M), (16 * TILE_M, 12 * TILE_M), TILE_M / 2)
        ground = bake_ground(stage, light, HALF_M, (rng, 0.16))
        ground.draw("floor", level(corners, tiled(rng, corners, TILE_M, stage.atlases["floor"])))
    route = _loop(0.0)
    _add_movers(stage, rng, route, settings)
    return stage.scene(TESTS, TAGS, light, route=route, reach_m=HALF_M + 0.2)


def _loop(outward_m: float) -> Array:
    """Go around the middle of the hall, `outward_m` outside the route."""
    x, y = ROUTE_M + outward_m
    corners = np.array([(x, -y), (x, y), (-x, y), (-x, -y)])
    return rounded_loop(corners, radius_m=min(1.0 + 0.35 * max(outward_m, 0), 1.8))


def _add_movers(stage: Stage, rng: np.random.Generator, route: Array, settings: Options) -> None:
    """Add pedestrians, porters and two carriers that go around in lanes, and the crossers."""
    senses = rng.choice([-1.0, 1.0], len(LANES_M))
    paces = rng.uniform(0.55, 1.1, len(LANES_M)) * settings.pace * senses
    paces[OVERTAKING] = 0.5 * settings.pace
    laps = [_loop(out) for out in LANES_M]
    lengths = [Lap(lap, 1.0, 0.0).marks_m[-1] for lap in laps]
    starts = rng.uniform(0, 1, len(LANES_M))
    starts[OVERTAKING] = -PORTER - rng.uniform(2.5, 7.0) / lengths[OVERTAKING]
    for k in range(settings.walkers):
        lane, turn = k % len(LANES_M), k // len(LANES_M)
        start = (starts[lane] + 0.31 * turn + rng.uniform(-0.05, 0.05)) * lengths[lane]
        people.person(stage, f"person_{k}", rng, Lap(laps[lane], paces[lane], start))
    for k, lane in enumerate((0, 5)):
        start = (starts[lane] + PORTER) * lengths[lane]
        people.carrier(stage, f"carrier_{k}", people.placed(Lap(laps[lane], paces[lane], start)))
    for lane, load, ahead_m in ((OVERTAKING, people.roll_cage, 0.86), (4, people.trolley, 0.98)):
        pusher = Lap(laps[lane], paces[lane], (starts[lane] + PORTER) * lengths[lane])
        people.person(stage, f"porter_{lane}", rng, pusher, 0.4)
        load(stage, load.__name__, rng, people.placed(pusher, ahead_m))
    for k in range(settings.crossers):
        walk = _crossing(rng, route, (k + rng.uniform(0.35, 0.65)) / settings.crossers)
        people.person(stage, f"crosser_{k}", rng, walk)


def _crossing(rng: np.random.Generator, route: Array, share: float) -> Walk:
    """Cross the route at a share of its length, 1.9 to 2.5 m ahead of the rover, on every lap."""
    marks = Lap(route, 1.0, 0.0).marks_m
    index = int(np.searchsorted(marks, share * marks[-1]))
    ahead = route[(index + 1) % len(route)] - route[index]
    across = np.array([-ahead[1], ahead[0]]) / np.linalg.norm(ahead)
    if across @ route[index] < 0:
        across = -across
    pace = rng.uniform(0.8, 1.0)
    inner, outer = route[index] - 2.7 * across, route[index] + 2.7 * across
    due = (marks[index] + marks[-1] * np.arange(LAPS) - rng.uniform(1.9, 2.5)) / ROVER_MPS
    return Crossing(inner, outer, ROVER_STARTS_S + due - 2.7 / pace, pace)


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("floor", masonry.terrazzo_tiles(rng, 16, 600))
    stage.material("clothes", people.clothing_atlas(rng))
    stage.material("posters", prints.posters(rng, 12, (420, 300)), 0.12)
    stage.material("screens", prints.screens(rng, 4, (200, 340)), 0.4)
    stage.material("cartons", prints.cartons(rng, 6, 256))
    stage.material("wall", masonry.plaster(rng, (512, 2048), (206, 200, 186), 0.3))
    stage.material("oak", timber.wood(rng, (512, 1024), (142, 106, 72)))
    stage.material("timber", timber.wood(rng, (256, 1024), (160, 122, 82)))
    stage.material("stone", masonry.concrete(rng, (1024, 1024), 166.0))
    stage.material("concrete", masonry.concrete(rng, (512, 512), 150.0))
    stage.material("steel", timber.painted(rng, (256, 256), (150, 152, 154)))
    stage.material("panel", timber.painted(rng, (512, 512), (182, 182, 178)))
    stage.material("drawer", timber.painted(rng, (512, 512), (96, 116, 132)))
    stage.material("iron", timber.painted(rng, (256, 256), (70, 74, 76)))
    stage.material("plastic", timber.painted(rng, (256, 256), (56, 58, 62)))
    stage.material("shell", timber.painted(rng, (512, 512), (196, 198, 196)))
    stage.material("dark", timber.painted(rng, (128, 128), (50, 50, 52)))
    stage.material("cone", timber.painted(rng, (64, 64), (204, 92, 44)))
    stage.material("red", timber.painted(rng, (256, 256), (152, 58, 48)))
    yellow, black = (206, 164, 52), (48, 46, 44)
    stage.material("hazard", signs.stripes(rng, (256, 256), (yellow, black), 32))
    stage.material("label", prints.posters(rng, 1, (64, 128))[0])
    stage.material("pot", timber.painted(rng, (256, 256), (92, 94, 98)))
    stage.material("soil", greenery.soil(rng, 256))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("glass", sky.window_view(rng, (128, 192)), 0.5)


def _walls(stage: Stage, rng: np.random.Generator) -> None:
    """Close the hall: windows above, posters below, glazed doors in the middle of two sides."""
    for k, run in enumerate(sides(HALF_M)):
        wall, length = run
        put = Pen(stage, wall)
        interior.wall(stage, f"wall_{k}", run, HEIGHT_M, (4.0, HEIGHT_M), board="oak")
        with stage.object(f"wall_{k}"):
            for along in np.arange(1.6, length - 1.0, 2.4):
                put("glass", box((along, -0.01, 3.2), (1.9, 0.02, 1.4)))
        with stage.object(f"posters_{k}"):
            for along in np.arange(0.9, length - 0.8, 1.9):
                if rng.random() < 0.75 and abs(along - length / 2) > 1.6:
                    sheet = box((along, -0.02, 1.35), (0.9, 0.03, 1.26), cell_m=0.3)
                    put.cell("posters", rng, sheet)
        if k % 2 == 1:
            with stage.object(f"doors_{k}"):
                for side in (-0.72, 0.72):
                    put("glass", box((length / 2 + side, -0.02, 1.2), (1.3, 0.02, 2.2)))
                for side in (-1.42, 0.0, 1.42):
                    put("steel", box((length / 2 + side, -0.04, 1.2), (0.1, 0.08, 2.4)))
                for z in (0.09, 1.0, 2.35):
                    put("steel", box((length / 2, -0.04, z), (2.8, 0.07, 0.12), bottom=True))


def _columns(stage: Stage) -> None:
    """Stand two rows of round columns outside the lanes."""
    x, y = ROUTE_M + 3.0
    spots = [(sx * x, sy * y) for sx in (-0.95, -0.33, 0.33, 0.95) for sy in (-0.97, 0.97)]
    for k, (px, py) in enumerate(spots):
        with stage.object(f"column_{k}"):
            stage.draw("stone", tube((px, py, 0), (px, py, 0.12), 0.32, 24))
            for z in np.arange(0.12, 3.9, 0.45):
                stage.draw("stone", tube((px, py, z), (px, py, z + 0.45), 0.25, 24))
        stage.obstacle(f"column_{k}", (px, py, 2.0), (0.48, 0.48, 4.0))


def _furnish(stage: Stage, rng: np.random.Generator) -> None:
    """Fill the middle with benches and an island, the walls with machines and plants."""
    planter(stage, "planter", rng, np.array([0.0, 0.0]), (1.8, 0.8, 0.45))
    for k, (px, turn) in enumerate(((-1.7, np.pi / 2), (1.7, -np.pi / 2))):
        bench(stage, f"bench_{k}", (px, rng.uniform(-0.1, 0.1), turn), rng)
    _kiosk(stage, "kiosk", rng, (rng.uniform(-0.1, 0.1), 0.68, 0.0))
    number = 0
    for wall, length in sides(HALF_M):
        for along in np.arange(1.1, length - 0.8, 1.35):
            if abs(along - length / 2) < 2.0 or rng.random() < 0.25:
                continue
            kind = rng.choice(["machine", "cabinet", "plant", "bin"], p=[0.35, 0.25, 0.2, 0.2])
            place, name = local(wall, float(along), -0.32), f"{kind}_{number}"
            if kind == "machine":
                _machine(stage, name, place, rng)
            elif kind == "cabinet":
                cabinet(stage, name, place, rng)
            elif kind == "plant":
                potted_plant(stage, name, rng, place[:2])
            else:
                bin_(stage, name, place)
            number += 1


@piece
def _machine(put: Pen, rng: np.random.Generator) -> None:
    """Put a ticket machine of 0.8 x 0.6 x 1.8 m against the wall."""
    body = "red" if rng.random() < 0.5 else "drawer"
    put(body, box((0, 0, 0.92), (0.8, 0.56, 1.76), (1.0, 1.0), rng.random(2), 0.25))
    put("plastic", box((0, 0, 0.03), (0.76, 0.52, 0.06)))
    put.cell("screens", rng, box((0, -0.285, 1.32), (0.46, 0.012, 0.3)))
    put("steel", box((0, -0.284, 0.86), (0.6, 0.012, 0.34), (0.5, 0.5)))
    put("dark", box((0.12, -0.292, 0.76), (0.24, 0.012, 0.08)))
    put.cell("posters", rng, box((0, -0.283, 0.4), (0.4, 0.008, 0.46)))
    put.solid((0.8, 0.58, 1.8))


@one_object
def _kiosk(stage: Stage, name: str, rng: np.random.Generator, place: Place) -> None:
    """Put an advertising pillar of 0.5 x 0.5 x 2.2 m with a picture on each side."""
    x, y, _ = place
    posters = stage.atlases["posters"]
    stage.draw("steel", box((x, y, 1.1), (0.5, 0.5, 2.2), (0.5, 0.5), cell_m=0.25))
    for k, turn in enumerate(np.arange(4) * np.pi / 2):
        sheet = patch((-0.21, -0.256, 0.55), (0.42, 0, 0), (0, 0, 0.9), (2, 4))
        rect = posters.rects[(int(rng.integers(posters.count)) + k) % posters.count]
        stage.draw("posters", sheet.textured(rect).moved((x, y, 0.0), turn))
    stage.obstacle(name, (x, y, 1.1), (0.5, 0.5, 2.2))
