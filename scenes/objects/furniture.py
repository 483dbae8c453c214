"""Office furniture: each piece draws itself on a stage and leaves one collision box."""

from collections.abc import Callable

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, merged, patch, tube
from scenes.stage import Stage, one_object
from scenes.surfaces.atlas import Atlas

Place = tuple[float, float, float]
"""x, y in metres and yaw in radians, of a piece whose front is towards -y before the turn."""

Put = Callable[[str, Mesh], None]


def at(stage: Stage, place: Place) -> Put:
    """Return a pen that draws meshes of the piece's own frame at its place."""
    x, y, yaw = place
    return lambda material, mesh: stage.draw(material, mesh.moved((x, y, 0.0), yaw))


def local(place: Place, dx: float, dy: float, turn_rad: float = 0.0) -> Place:
    """Return the place of something at (dx, dy) in a piece's own frame, turned further."""
    x, y, yaw = place
    c, s = np.cos(yaw), np.sin(yaw)
    return (float(x + c * dx - s * dy), float(y + s * dx + c * dy), yaw + turn_rad)


def solid(stage: Stage, name: str, place: Place, size: Vector, shadow: bool = True) -> None:
    """Add the collision box of (3,) full size that stands at a place."""
    stage.obstacle(name, (place[0], place[1], size[2] / 2), size, place[2], shadow)


@one_object
def desk(stage: Stage, name: str, rng: np.random.Generator, place: Place, screens: Atlas) -> None:
    """Set up a workplace of 1.6 x 0.8 m: top, legs, drawers, screen, keyboard, papers."""
    put = at(stage, place)
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
    picture = patch((-0.265, 0.163, 0.865), (0.53, 0, 0), (0, 0, 0.31))
    put("screens", picture.textured(screens.rects[rng.integers(screens.count)]))
    put("keyboard", box((0, -0.15, 0.752), (0.44, 0.15, 0.02)))
    solid(stage, name, place, (1.6, 0.8, 0.74), shadow=False)
    stage.blocker((place[0], place[1], 0.725), (1.6, 0.8, 0.03), place[2], 0.9)
    drawers = local(place, 0.46 * side, 0.05)
    stage.blocker((drawers[0], drawers[1], 0.3), (0.4, 0.55, 0.58), place[2], 0.9)


@one_object
def chair(stage: Stage, name: str, rng: np.random.Generator, place: Place) -> None:
    """Put a swivel chair on a five-armed base."""
    put = at(stage, place)
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
    solid(stage, name, place, (0.56, 0.56, 0.9), shadow=False)
    stage.blocker((place[0], place[1], 0.47), (0.48, 0.46, 0.08), place[2])
    stage.blocker((place[0], place[1], 0.07), (0.34, 0.34, 0.08), place[2], 0.5)


@one_object
def bookcase(
    stage: Stage,
    name: str,
    rng: np.random.Generator,
    place: Place,
    books: Atlas,
    cartons: Atlas,
) -> None:
    """Put a bookcase of 1.0 x 0.34 x 1.8 m, its boards filled with books or boxes."""
    put = at(stage, place)
    width, depth, height, board = 1.0, 0.34, 1.8, 0.022
    for x in (-(width - board) / 2, (width - board) / 2):
        put("beech", box((x, 0, height / 2), (board, depth, height), (1.6, 0.8), rng.random(2)))
    put("panel", box((0, depth / 2 - 0.005, height / 2), (width - 2 * board, 0.008, height - 0.02)))
    inner = width - 2 * board - 0.004
    levels = 0.06 + 0.345 * np.arange(6)
    for z in levels[levels < height]:
        shelf = box((0, -0.003, z), (inner, depth - 0.02, board), (1.6, 0.8), rng.random(2))
        put("beech", merged([shelf]))
        free = -inner / 2
        while free < inner / 2 - 0.2 and z < height - 0.3:
            wide = min(float(rng.uniform(0.24, 0.5)), inner / 2 - free - 0.004)
            middle = free + wide / 2
            if rng.random() < 0.75:
                tall, back = 0.29, rng.uniform(0.0, 0.025)
                block = box((middle, back, z + 0.012 + tall / 2), (wide - 0.006, 0.25, tall))
                put("books", block.textured(_window(rng, books, wide)))
            else:
                tall = float(rng.uniform(0.16, 0.27))
                block = box((middle, 0.0, z + 0.012 + tall / 2), (wide - 0.03, 0.28, tall))
                put("cartons", block.textured(cartons.rects[rng.integers(cartons.count)]))
            free += wide
    solid(stage, name, place, (width, depth, height))


def _window(rng: np.random.Generator, atlas: Atlas, wide_m: float) -> np.ndarray:
    """Cut a stretch of `wide_m` metres out of a random one of the metre-long book rows."""
    u0, v0, u1, v1 = atlas.rects[rng.integers(atlas.count)]
    start = u0 + (u1 - u0) * rng.uniform(0, 1 - wide_m)
    return np.array([start, v0, start + (u1 - u0) * wide_m, v1])


@one_object
def cabinet(stage: Stage, name: str, rng: np.random.Generator, place: Place) -> None:
    """Put a filing cabinet of 0.8 x 0.45 x 1.1 m with four drawers."""
    put = at(stage, place)
    put("panel", box((0, 0, 0.56), (0.8, 0.45, 1.06), (1.0, 1.0), rng.random(2), 0.3))
    put("plastic", box((0, 0.0, 0.015), (0.76, 0.41, 0.03), (0.5, 0.5)))
    for z in (0.17, 0.42, 0.67, 0.92):
        front = box((0, -0.232, z), (0.77, 0.014, 0.235), (1.0, 1.0), rng.random(2), 0.3)
        put("drawer", front)
        put("steel", box((0, -0.248, z + 0.05), (0.2, 0.018, 0.016), (0.5, 0.5), bottom=True))
        put("label", box((0, -0.2405, z - 0.02), (0.09, 0.003, 0.045)))
    solid(stage, name, place, (0.8, 0.45, 1.1))


@one_object
def cartons_stack(
    stage: Stage, name: str, rng: np.random.Generator, place: Place, atlas: Atlas
) -> None:
    """Stack one to three cartons, each turned a little."""
    base = 0.0
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform((0.3, 0.28, 0.2), (0.42, 0.36, 0.34))
        turn = rng.uniform(-0.2, 0.2)
        block = box((0, 0, base + size[2] / 2), size, cell_m=0.2)
        side = block.textured(atlas.rects[rng.integers(atlas.count)])
        stage.draw("cartons", side.moved((place[0], place[1], 0.0), place[2] + turn))
        base += float(size[2]) + 0.001
    solid(stage, name, place, (0.44, 0.38, base))


@one_object
def bin_(stage: Stage, name: str, place: Place) -> None:
    """Put a round waste-paper bin."""
    put = at(stage, place)
    put("plastic", tube((0, 0, 0.0), (0, 0, 0.32), 0.11, 16, 1.25))
    solid(stage, name, place, (0.26, 0.26, 0.32))


@one_object
def whiteboard(stage: Stage, name: str, place: Place) -> None:
    """Put a whiteboard on castors, its lower edge at 0.35 m."""
    put = at(stage, place)
    put("steel", box((0, 0.012, 1.05), (1.5, 0.02, 1.44), (0.5, 0.5), bottom=True))
    put("notes", box((0, -0.004, 1.05), (1.46, 0.01, 1.40)))
    for x in (-0.7, 0.7):
        put("steel", tube((x, 0.03, 0.06), (x, 0.03, 0.4), 0.02))
        put("steel", box((x, 0.03, 0.055), (0.04, 0.3, 0.03), (0.5, 0.5), bottom=True))
        for y in (-0.08, 0.14):
            put("plastic", tube((x - 0.015, y, 0.025), (x + 0.015, y, 0.025), 0.024, 10))
    solid(stage, name, place, (1.5, 0.36, 1.7), shadow=False)
    stage.blocker((place[0], place[1], 1.05), (1.5, 0.03, 1.44), place[2])
