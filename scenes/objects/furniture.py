"""Office furniture: functions that draw one piece on a stage and add its collision box."""

import numpy as np

from scenes.geometry.mesh import box, patch, tube
from scenes.objects.props import potted_plant
from scenes.pen import Pen, Place, local, one_object, piece
from scenes.stage import Stage
from vo.contract.arrays import Array


@piece
def desk(put: Pen, rng: np.random.Generator) -> None:
    """Set up a workplace of 1.6 x 0.8 m: top, legs, drawers, screen, keyboard, papers."""
    put("beech", box((0, 0, 0.725), (1.6, 0.8, 0.03), (1.6, 0.8), rng.random(2), 0.3, True))
    for x in (-0.74, 0.74):
        put("steel", box((x, 0.0, 0.685), (0.05, 0.7, 0.05), (0.5, 0.5), rng.random(2), 0.3, True))
        for y in (-0.33, 0.33):
            put("steel", box((x, y, 0.34), (0.05, 0.05, 0.66), (0.5, 0.5), rng.random(2), 0.2))
        put("steel", box((x, 0.0, 0.012), (0.06, 0.74, 0.024), (0.5, 0.5), rng.random(2), 0.3))
    put("panel", box((0, 0.3, 0.53), (1.42, 0.018, 0.32), (1.0, 1.0), rng.random(2), 0.3, True))
    side = rng.choice([-1.0, 1.0])
    put("panel", box((0.46 * side, 0.05, 0.31), (0.4, 0.55, 0.56), (1.0, 1.0), cell_m=0.2))
    for z in (0.14, 0.31, 0.48):
        front = box((0.46 * side, -0.236, z), (0.38, 0.014, 0.16), (1.0, 1.0), rng.random(2), 0.2)
        put("drawer", front)
        put("steel", box((0.46 * side, -0.25, z + 0.03), (0.14, 0.012, 0.012), (0.5, 0.5)))
    put("steel", tube((0, 0.2, 0.745), (0, 0.2, 0.95), 0.02))
    put("steel", box((0, 0.2, 0.746), (0.24, 0.18, 0.012), (0.5, 0.5)))
    put("plastic", box((0, 0.18, 1.02), (0.56, 0.03, 0.34), (0.5, 0.5), bottom=True))
    put.cell("screens", rng, patch((-0.265, 0.163, 0.865), (0.53, 0, 0), (0, 0, 0.31)))
    put("keyboard", box((0, -0.15, 0.752), (0.44, 0.15, 0.02)))
    put.solid((1.6, 0.8, 0.74), shadow=False)
    put.shade(0.725, (1.6, 0.8, 0.03), 0.9)
    put.shade(0.3, (0.4, 0.55, 0.58), 0.9, (0.46 * side, 0.05))


@piece
def chair(put: Pen, rng: np.random.Generator) -> None:
    """Put a swivel chair on a five-armed base."""
    put("cloth", box((0, 0, 0.47), (0.48, 0.46, 0.08), (0.4, 0.4), rng.random(2), 0.25, True))
    put("cloth", box((0, 0.25, 0.80), (0.44, 0.07, 0.5), (0.4, 0.4), rng.random(2), 0.25, True))
    put("plastic", box((0, 0.27, 0.52), (0.08, 0.04, 0.2), (0.5, 0.5), bottom=True))
    put("steel", tube((0, 0, 0.10), (0, 0, 0.43), 0.028))
    for angle in np.arange(5) * 2 * np.pi / 5 + rng.uniform(0, 1):
        out = np.array([np.cos(angle), np.sin(angle)])
        put("plastic", tube((0, 0, 0.125), (*0.29 * out, 0.085), 0.03, 8, 0.6))
        wheel = np.array([*0.29 * out, 0.03])
        axle = 0.022 * np.array([-out[1], out[0], 0])
        put("plastic", tube(wheel - axle, wheel + axle, 0.028, 10))
    for x in (-0.27, 0.27):
        put("plastic", box((x, 0.02, 0.66), (0.05, 0.26, 0.03), (0.5, 0.5), bottom=True))
        put("plastic", box((x, 0.06, 0.55), (0.03, 0.05, 0.2), (0.5, 0.5)))
    put.solid((0.56, 0.56, 0.9), shadow=False)
    put.shade(0.47, (0.48, 0.46, 0.08))
    put.shade(0.07, (0.34, 0.34, 0.08), 0.5)


@piece
def bookcase(put: Pen, rng: np.random.Generator) -> None:
    """Put a bookcase of 1.0 x 0.34 x 1.8 m, its boards filled with books or boxes."""
    width, depth, height, board = 1.0, 0.34, 1.8, 0.022
    for x in (-(width - board) / 2, (width - board) / 2):
        put("beech", box((x, 0, height / 2), (board, depth, height), (1.6, 0.8), rng.random(2)))
    put("panel", box((0, depth / 2 - 0.005, height / 2), (width - 2 * board, 0.008, height - 0.02)))
    inner = width - 2 * board - 0.004
    levels = 0.06 + 0.345 * np.arange(6)
    for z in levels[levels < height]:
        put("beech", box((0, -0.003, z), (inner, depth - 0.02, board), (1.6, 0.8), rng.random(2)))
        free = -inner / 2
        while free < inner / 2 - 0.2 and z < height - 0.3:
            wide = min(float(rng.uniform(0.24, 0.5)), inner / 2 - free - 0.004)
            middle = free + wide / 2
            if rng.random() < 0.75:
                tall, back = 0.29, rng.uniform(0.0, 0.025)
                block = box((middle, back, z + 0.012 + tall / 2), (wide - 0.006, 0.25, tall))
                put("books", block.textured(row_of_books(put.stage, rng, wide)))
            else:
                tall = float(rng.uniform(0.16, 0.27))
                block = box((middle, 0.0, z + 0.012 + tall / 2), (wide - 0.03, 0.28, tall))
                put.cell("cartons", rng, block)
            free += wide
    put.solid((width, depth, height))


def row_of_books(stage: Stage, rng: np.random.Generator, length_m: float) -> Array:
    """Cut a stretch of `length_m` metres out of a random one of the metre-long rows: (4,) cell."""
    u0, v0, u1, v1 = stage.pick("books", rng)
    start = u0 + (u1 - u0) * rng.uniform(0, 1 - length_m)
    return np.array([start, v0, start + (u1 - u0) * length_m, v1])


@piece
def cabinet(put: Pen, rng: np.random.Generator) -> None:
    """Put a filing cabinet of 0.8 x 0.45 x 1.1 m with four drawers."""
    put("panel", box((0, 0, 0.56), (0.8, 0.45, 1.06), (1.0, 1.0), rng.random(2), 0.3))
    put("plastic", box((0, 0.0, 0.015), (0.76, 0.41, 0.03), (0.5, 0.5)))
    for z in (0.17, 0.42, 0.67, 0.92):
        put("drawer", box((0, -0.232, z), (0.77, 0.014, 0.235), (1.0, 1.0), rng.random(2), 0.3))
        put("steel", box((0, -0.248, z + 0.05), (0.2, 0.018, 0.016), (0.5, 0.5), bottom=True))
        put("label", box((0, -0.2405, z - 0.02), (0.09, 0.003, 0.045)))
    put.solid((0.8, 0.45, 1.1))


@one_object
def cartons_stack(stage: Stage, name: str, rng: np.random.Generator, place: Place) -> None:
    """Stack one to three cartons, each turned a little."""
    base = 0.0
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform((0.3, 0.28, 0.2), (0.42, 0.36, 0.34))
        turn = rng.uniform(-0.2, 0.2)
        block = box((0, 0, base + size[2] / 2), size, cell_m=0.2)
        Pen(stage, local(place, 0.0, 0.0, turn)).cell("cartons", rng, block)
        base += float(size[2]) + 0.001
    Pen(stage, place, name).solid((0.44, 0.38, base))


@piece
def bin_(put: Pen) -> None:
    """Put a round waste-paper bin."""
    put("plastic", tube((0, 0, 0.0), (0, 0, 0.32), 0.11, 16, 1.25))
    put.solid((0.26, 0.26, 0.32))


@piece
def whiteboard(put: Pen) -> None:
    """Put a whiteboard on castors, its lower edge at 0.35 m."""
    put("steel", box((0, 0.012, 1.05), (1.5, 0.02, 1.44), (0.5, 0.5), bottom=True))
    put("notes", box((0, -0.004, 1.05), (1.46, 0.01, 1.40)))
    for x in (-0.7, 0.7):
        put("steel", tube((x, 0.03, 0.06), (x, 0.03, 0.4), 0.02))
        put("steel", box((x, 0.03, 0.055), (0.04, 0.3, 0.03), (0.5, 0.5), bottom=True))
        for y in (-0.08, 0.14):
            put("plastic", tube((x - 0.015, y, 0.025), (x + 0.015, y, 0.025), 0.024, 10))
    put.solid((1.5, 0.36, 1.7), shadow=False)
    put.shade(1.05, (1.5, 0.03, 1.44))


def against_wall(
    stage: Stage, name: str, rng: np.random.Generator, wall: Place, kind: str, plant_m: float = 0.28
) -> None:
    """Stand a bookcase, a cabinet, a plant or cartons with their back to a place on a wall."""
    if kind == "books":
        bookcase(stage, name, local(wall, 0, -0.20), rng)
    elif kind == "plant":
        potted_plant(stage, name, rng, local(wall, 0, -plant_m)[:2])
    elif kind == "cabinet":
        cabinet(stage, name, local(wall, 0, -0.26), rng)
    else:
        place = local(wall, rng.uniform(-0.2, 0.2), -0.25, rng.uniform(-0.1, 0.1))
        cartons_stack(stage, name, rng, place)
