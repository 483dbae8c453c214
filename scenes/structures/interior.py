"""Rooms: walls with skirting, doors, ceilings, and equipment on walls."""

from dataclasses import replace

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged, patch, tube
from scenes.pen import Pen, Place, one_object, piece
from scenes.stage import Stage
from scenes.structures.ground import level, quads
from vo.contract.arrays import Array

WALL_M = 0.12
SKIRTING_M = 0.1
Run = tuple[Place, float]
"""Place and length in metres of a wall: x runs along the wall, -y points into the room."""


def sides(half: Array) -> list[Run]:
    """List the walls of a room of (2,) half sizes, metres: north, east, south, west."""
    x, y = half
    return [
        ((-x, y, 0.0), 2 * x),
        ((x, y, -np.pi / 2), 2 * y),
        ((x, -y, np.pi), 2 * x),
        ((-x, -y, np.pi / 2), 2 * y),
    ]


def around(half: Array) -> list[Run]:
    """List the walls of a block of (2,) half sizes, seen from outside: south, east, north, west."""
    x, y = half
    return [
        ((-x, -y, 0.0), 2 * x),
        ((x, -y, np.pi / 2), 2 * y),
        ((x, y, np.pi), 2 * x),
        ((-x, y, -np.pi / 2), 2 * y),
    ]


def wall_face(run: Run, height_m: float, period_m: tuple[float, float]) -> Mesh:
    """Build the painted face of a wall, divided finely enough for baked light."""
    (x, y, yaw), length = run
    cells = (int(np.ceil(length / 0.3)), int(np.ceil(height_m / 0.3)))
    offset = ((x + y) / period_m[0], 0.0)
    face = patch((0, 0, 0), (length, 0, 0), (0, 0, height_m), cells, period_m, offset)
    return face.moved((x, y, 0.0), yaw)


def skirting(run: Run) -> Mesh:
    """Build the board along the foot of a wall."""
    (x, y, yaw), length = run
    size = (length - 0.01, 0.012, SKIRTING_M)
    return box((length / 2, -0.006, SKIRTING_M / 2), size, (1.2, 0.6)).moved((x, y, 0.0), yaw)


@one_object
def wall(
    stage: Stage,
    name: str,
    run: Run,
    height_m: float,
    period_m: tuple[float, float],
    paint: str = "wall",
    board: str = "skirting",
) -> None:
    """Build a wall of a room: painted face, skirting board and collision box."""
    stage.draw(paint, wall_face(run, height_m, period_m))
    stage.draw(board, skirting(run))
    collide(stage, name, run, height_m)


def ceiling(stage: Stage, half: Array, height_m: float, cell_m: float, period_m: float) -> None:
    """Close a room of (2,) half sizes by a ceiling in cells of `cell_m`."""
    corners = quads(-half, half, cell_m)
    down = level(corners, corners / period_m, height_m)
    stage.draw("ceiling", replace(down, normals=-down.normals, faces=down.faces[:, ::-1]))


def collide(stage: Stage, name: str, run: Run, height_m: float) -> None:
    """Add the collision box of a wall, which stands behind its face and casts no shadow."""
    wall, length = run
    size = (length + 2 * WALL_M, WALL_M, height_m)
    Pen(stage, wall, name).solid(size, (length / 2, WALL_M / 2), shadow=False)


@piece
def door(put: Pen, rng: np.random.Generator, along_m: float, sign: Array) -> None:
    """Hang a plain door in a full frame on a wall, its (4,) sign on a plate beside it."""
    put("leaf", box((along_m, -0.008, 1.02), (0.92, 0.016, 2.04), (1.2, 2.2), rng.random(2)))
    for side in (-0.49, 0.49):
        put("frame", box((along_m + side, -0.02, 1.04), (0.07, 0.04, 2.08), (0.5, 0.5)))
    put("frame", box((along_m, -0.02, 2.075), (1.05, 0.04, 0.07), (0.5, 0.5), bottom=True))
    hinge = -1.0 if rng.random() < 0.5 else 1.0
    lever = along_m - 0.36 * hinge
    put("steel", box((lever, -0.019, 1.02), (0.045, 0.008, 0.17), (0.5, 0.5)))
    put("steel", box((lever + 0.05 * hinge, -0.055, 1.05), (0.13, 0.018, 0.018), bottom=True))
    for z in (0.25, 1.8):
        foot = (along_m + 0.455 * hinge, -0.022)
        put("steel", tube((*foot, z), (*foot, z + 0.1), 0.008, 6))
    put("signs", box((lever - 0.22 * hinge, -0.004, 1.5), (0.15, 0.006, 0.15)).textured(sign))


@piece
def extinguisher(put: Pen, along_m: float, sign: Array) -> None:
    """Hang a fire extinguisher on a wall, under its sign."""
    y = -0.11
    put("red", tube((along_m, y, 0.28), (along_m, y, 0.72), 0.075, 16))
    put("red", tube((along_m, y, 0.72), (along_m, y, 0.78), 0.075, 16, 0.4))
    put("plastic", tube((along_m, y, 0.78), (along_m, y, 0.84), 0.018, 8))
    put("plastic", box((along_m + 0.03, y, 0.85), (0.11, 0.02, 0.02), bottom=True))
    put("plastic", tube((along_m + 0.03, y, 0.81), (along_m + 0.1, y, 0.45), 0.011, 8))
    put("label", box((along_m, y - 0.074, 0.52), (0.09, 0.006, 0.16)))
    put("signs", box((along_m, -0.004, 1.45), (0.2, 0.006, 0.2)).textured(sign))
    put.solid((0.16, 0.2, 0.9), (along_m, y / 2), shadow=False)


@piece
def notice_board(put: Pen, rng: np.random.Generator, along_m: float) -> None:
    """Hang a cork board of 1.2 x 0.9 m on a wall with sheets of paper pinned to it."""
    put("cork", box((along_m, -0.01, 1.4), (1.2, 0.02, 0.9), (0.8, 0.8), rng.random(2)))
    for z in (0.95, 1.85):
        put("steel", box((along_m, -0.014, z), (1.24, 0.03, 0.03), (0.5, 0.5), bottom=True))
    for x in (-0.605, 0.605):
        put("steel", box((along_m + x, -0.014, 1.4), (0.03, 0.03, 0.93), (0.5, 0.5)))
    for x in (-0.43, -0.14, 0.15, 0.44):
        for z in (1.2, 1.6):
            if rng.random() < 0.75:
                spot = (along_m + x + rng.normal(0, 0.02), -0.022, z + rng.normal(0, 0.03))
                put.cell("posters", rng, box(spot, (0.21, 0.004, 0.297)))


@piece
def radiator(put: Pen, along_m: float) -> None:
    """Hang a ribbed radiator of 0.9 x 0.5 m low on a wall, with its pipes."""
    for x in np.arange(-0.42, 0.43, 0.06):
        put("radiator", box((along_m + x, -0.07, 0.4), (0.045, 0.06, 0.5), bottom=True))
    put("radiator", box((along_m, -0.055, 0.4), (0.9, 0.03, 0.46), bottom=True))
    for x in (-0.4, 0.4):
        put("radiator", tube((along_m + x, -0.06, 0.0), (along_m + x, -0.06, 0.16), 0.01, 8))
    put("plastic", tube((along_m + 0.45, -0.07, 0.58), (along_m + 0.52, -0.07, 0.58), 0.022, 10))
    put.solid((0.95, 0.1, 0.7), (along_m, -0.05), shadow=False)


def ceiling_panel(stage: Stage, place: Array, size: tuple[float, float]) -> None:
    """Let a bright panel in a thin frame into the ceiling at (3,) metres; light is not baked."""
    x, y, z = place
    for side, (sx, sy) in enumerate((size, (size[0] + 0.06, size[1] + 0.06))):
        low = (x - sx / 2, y + sy / 2, z - 0.012 + 0.006 * side)
        stage.draw("panel" if side else "lamp", patch(low, (sx, 0, 0), (0, -sy, 0)))


@piece
def exit_sign(put: Pen, height_m: float, sign: Array) -> None:
    """Hang a lit sign for the way out from a ceiling at `height_m`, readable from both sides."""
    put("steel", box((0, 0, height_m - 0.1), (0.02, 0.02, 0.2)))
    put("steel", box((0, 0, height_m - 0.28), (0.42, 0.03, 0.2), bottom=True))
    face = patch((-0.2, -0.016, height_m - 0.37), (0.4, 0, 0), (0, 0, 0.18)).textured(sign)
    put("signs_lit", merged([face, face.moved((0, 0, 0), np.pi)]))
