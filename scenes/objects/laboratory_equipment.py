"""Laboratory equipment: benches, instruments, bottles, cables, stools and gas bottles."""

import itertools

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, merged, tube
from scenes.objects.props import ball
from scenes.pen import Pen, piece
from vo.contract.arrays import Array

TOP_M = 0.9
DEPTH_M = 0.7
SHELVES_M = (1.38, 1.74)
CABLES = ("cable_red", "cable_blue", "cable_black")


@piece
def bench(put: Pen, rng: np.random.Generator, length_m: float) -> None:
    """Put a wall bench, its back at the place: cabinets, worktop and a duct with sockets."""
    middle = -DEPTH_M / 2
    top = (length_m, DEPTH_M, 0.035)
    put("worktop", box((0, middle, TOP_M - 0.018), top, (1.2, 1.2), rng.random(2), 0.3, True))
    count = max(1, round(length_m / 0.6))
    wide = length_m / count
    for k in range(count):
        x = -length_m / 2 + (k + 0.5) * wide
        if rng.random() < 0.22 and 0 < k < count - 1:
            continue  # room for knees
        body = (wide, DEPTH_M - 0.08, 0.76)
        put("panel", box((x, middle + 0.02, 0.485), body, (1.0, 1.0), rng.random(2)))
        put("plastic", box((x, middle + 0.04, 0.05), (wide, DEPTH_M - 0.16, 0.1), (0.5, 0.5)))
        _cabinet_front(put, rng, x, wide)
    duct = (length_m, 0.07, 0.13)
    put("panel", box((0, -0.035, TOP_M + 0.165), duct, (1.0, 1.0), bottom=True))
    for x in np.arange(-length_m / 2 + 0.2, length_m / 2 - 0.1, 0.3):
        put("plastic", box((x, -0.0715, TOP_M + 0.165), (0.075, 0.004, 0.075)))
        put("worktop", box((x, -0.074, TOP_M + 0.165), (0.045, 0.003, 0.045), (1.2, 1.2)))
    put.solid((length_m, DEPTH_M, TOP_M), (0, middle))


def _cabinet_front(put: Pen, rng: np.random.Generator, x: float, wide: float) -> None:
    """Draw one door or four drawers."""
    face = -DEPTH_M + 0.055
    drawers = tuple((z, 0.175) for z in (0.2, 0.39, 0.58, 0.77))
    levels = ((0.485, 0.74),) if rng.random() < 0.5 else drawers
    for z, high in levels:
        put("drawer", box((x, face, z), (wide - 0.015, 0.016, high), (1.0, 1.0), rng.random(2)))
        grip = z + high / 2 - 0.045
        put("steel", box((x, face - 0.016, grip), (0.13, 0.014, 0.014), (0.5, 0.5), bottom=True))


@piece
def shelf(put: Pen, rng: np.random.Generator, length_m: float) -> None:
    """Hang two boards above a bench, filled with bottles, boxes and books."""
    for z in SHELVES_M:
        board = (length_m, 0.26, 0.022)
        put("beech", box((0, -0.13, z), board, (1.6, 0.8), rng.random(2), bottom=True))
        for x in np.linspace(-length_m / 2 + 0.15, length_m / 2 - 0.15, 3):
            put("steel", box((x, -0.12, z - 0.06), (0.02, 0.22, 0.1), (0.5, 0.5), bottom=True))
        along = -length_m / 2 + 0.05
        while along < length_m / 2 - 0.3:
            along += _shelved(put, rng, along, z + 0.011)


def _shelved(put: Pen, rng: np.random.Generator, x: float, z: float) -> float:
    """Put one thing or a row of bottles at x on a board; return the length that it takes."""
    draw = rng.random()
    if draw < 0.4:
        count = int(rng.integers(2, 5))
        for k in range(count):
            _bottle(put, rng, (x + 0.05 + 0.1 * k, -0.12 + rng.normal(0, 0.02), z))
        return 0.1 * count + 0.04
    if draw < 0.65:
        wide, high = rng.uniform(0.16, 0.27), rng.uniform(0.12, 0.24)
        put.cell("cartons", rng, box((x + wide / 2, -0.13, z + high / 2), (wide, 0.2, high)))
        return wide + 0.03
    if draw < 0.85:
        put("books", box((x + 0.14, -0.12, z + 0.13), (0.27, 0.2, 0.26)).textured(_books(put, rng)))
        return 0.3
    return float(rng.uniform(0.06, 0.2))


def _books(put: Pen, rng: np.random.Generator) -> Array:
    """Cut 0.27 of the length of a random row of books: (4,) cell."""
    u0, v0, u1, v1 = put.stage.pick("books", rng)
    start = rng.uniform(0, 0.7)
    return np.array([u0 + (u1 - u0) * start, v0, u0 + (u1 - u0) * (start + 0.27), v1])


def _bottle(put: Pen, rng: np.random.Generator, foot: Vector) -> None:
    radius, high = rng.uniform(0.026, 0.044), rng.uniform(0.11, 0.22)
    base = np.array(foot)
    neck, cap = base + np.array([0, 0, high]), base + np.array([0, 0, high + 0.03])
    put.cell("wraps", rng, tube(base, neck, radius, 12))
    put("plastic", tube(neck, cap, 0.6 * radius, 10, 0.8))


@piece
def instrument(put: Pen, rng: np.random.Generator, base_m: float) -> None:
    """Put a measuring instrument at a height, perhaps a second one on top, and plug cables in."""
    table_m = base_m
    for _ in range(2 if rng.random() < 0.35 else 1):
        wide, deep, high = rng.uniform((0.28, 0.24, 0.12), (0.42, 0.34, 0.2))
        put("plastic", box((0, 0, base_m + 0.008), (wide - 0.04, deep - 0.04, 0.016), (0.5, 0.5)))
        case = box((0, 0, base_m + 0.016 + high / 2), (wide, deep, high), (1.0, 1.0), rng.random(2))
        put("panel", case)
        face = box((0, -deep / 2 - 0.004, base_m + 0.016 + high / 2), (wide, 0.008, high))
        put.cell("fronts", rng, face)
        for _ in range(int(rng.integers(1, 4))):
            socket = (rng.uniform(-0.4, 0.4) * wide, -deep / 2 - 0.008, base_m + 0.04)
            reach = rng.uniform((-0.5, -0.06), (0.5, 0.02))
            end = (socket[0] + reach[0], socket[1] - 0.06 + reach[1], table_m + 0.006)
            put(CABLES[rng.integers(3)], cable(rng, socket, end))
        base_m += high + 0.016


def cable(rng: np.random.Generator, start: Vector, end: Vector) -> Mesh:
    """Lay a thin cable between two points: out of a socket, down and along in a curve."""
    a, b = np.array(start), np.array(end)
    out = a + np.array([0, -rng.uniform(0.05, 0.1), -0.3 * (a[2] - b[2])])
    bow = (a + b) / 2 + np.array([*rng.normal(0, 0.05, 2), 0])
    bow[2] = b[2]
    t = np.linspace(0, 1, 9)[:, None]
    knots = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * out + 3 * (1 - t) * t**2 * bow + t**3 * b
    return merged([tube(p, q, 0.0045, 6) for p, q in itertools.pairwise(knots)])


@piece
def microscope(put: Pen, base_m: float) -> None:
    """Put a microscope at a height."""
    put("plastic", box((0, 0, base_m + 0.02), (0.18, 0.24, 0.04), (0.5, 0.5)))
    put("panel", box((0, 0.08, base_m + 0.17), (0.06, 0.06, 0.28), (1.0, 1.0)))
    put("plastic", box((0, -0.02, base_m + 0.13), (0.14, 0.14, 0.015), (0.5, 0.5), bottom=True))
    put("panel", box((0, 0.01, base_m + 0.31), (0.07, 0.2, 0.06), (1.0, 1.0), bottom=True))
    put("steel", tube((0, -0.03, base_m + 0.28), (0, -0.03, base_m + 0.17), 0.02, 10, 0.7))
    for x in (-0.03, 0.03):
        put("plastic", tube((x, -0.05, base_m + 0.33), (x, -0.13, base_m + 0.42), 0.018, 10))


@piece
def tray(put: Pen, rng: np.random.Generator, base_m: float) -> None:
    """Put a tray of bottles at a height, and loose sheets beside it."""
    put("steel", box((0, 0, base_m + 0.008), (0.4, 0.26, 0.016), (0.5, 0.5)))
    for x in np.arange(-0.14, 0.15, 0.095):
        for y in (-0.06, 0.06):
            if rng.random() < 0.7:
                _bottle(put, rng, (x, y, base_m + 0.016))
    sheet = box((0.36, -0.05, base_m + 0.002), (0.21, 0.297, 0.003))
    put("posters", sheet.textured(np.array([0.02, 0.02, 0.2, 0.3])))


@piece
def stool(put: Pen, rng: np.random.Generator) -> None:
    """Put a round stool on a five-armed foot."""
    put("cloth", tube((0, 0, 0.54), (0, 0, 0.61), 0.17, 18))
    put("steel", tube((0, 0, 0.08), (0, 0, 0.54), 0.025, 10))
    for angle in np.arange(5) * 2 * np.pi / 5 + rng.uniform(0, 1):
        tip = 0.25 * np.array([np.cos(angle), np.sin(angle)])
        put("plastic", tube((0, 0, 0.1), (*tip, 0.05), 0.022, 8, 0.7))
        put("plastic", ball(rng, (*tip, 0.028), 0.026))
    put.solid((0.5, 0.5, 0.61), shadow=False)
    put.stage.occluder((*put.place[:2], 0.57), (0.3, 0.3, 0.08), 0.3)


@piece
def gas_bottles(put: Pen) -> None:
    """Chain two gas bottles to a wall, their back at the place."""
    for x, paint in ((-0.14, "cable_blue"), (0.14, "gas")):
        put(paint, tube((x, -0.15, 0), (x, -0.15, 1.25), 0.115, 18))
        put(paint, tube((x, -0.15, 1.25), (x, -0.15, 1.38), 0.115, 18, 0.35))
        put("steel", tube((x, -0.15, 1.38), (x, -0.15, 1.46), 0.03, 10))
        put("steel", box((x, -0.19, 1.44), (0.03, 0.1, 0.03), bottom=True))
        put("label", box((x, -0.262, 0.95), (0.11, 0.012, 0.16)))
    for z in (0.5, 1.05):
        put("steel", box((0, -0.275, z), (0.56, 0.012, 0.03), (0.5, 0.5), bottom=True))
    put.solid((0.56, 0.3, 1.45), (0, -0.14))


@piece
def island(put: Pen, rng: np.random.Generator, size: Array) -> None:
    """Put a heavy table of (2,) full size on four legs, with a board of holes for optics."""
    length, depth = size
    put("worktop", box((0, 0, 0.80), (length, depth, 0.06), (1.2, 1.2), rng.random(2), bottom=True))
    put("holes", box((0, 0, 0.836), (length - 0.16, depth - 0.16, 0.012), (0.25, 0.25)))
    for x in (-0.42, 0.42):
        for y in (-0.4, 0.4):
            leg = (0.08, 0.08, 0.77)
            put("steel", box((x * length, y * depth, 0.385), leg, (0.5, 0.5), rng.random(2)))
    put("panel", box((0, 0, 0.2), (0.84 * length, 0.8 * depth, 0.02), (1.0, 1.0), bottom=True))
    put.solid((length, depth, 0.84), shadow=False)
    put.shade(0.8, (length, depth, 0.06))
    put.shade(0.2, (0.84 * length, 0.8 * depth, 0.02), 0.8)


@piece
def optics(put: Pen, rng: np.random.Generator, base_m: float) -> None:
    """Put a row of posts with mounts and lenses at a height."""
    put("steel", box((0, 0, base_m + 0.012), (0.5, 0.05, 0.024), (0.5, 0.5)))
    for x in np.arange(-0.2, 0.21, 0.1) + rng.normal(0, 0.012, 5):
        high = base_m + rng.uniform(0.1, 0.16)
        put("steel", tube((x, 0, base_m + 0.02), (x, 0, high), 0.009, 8))
        put("plastic", tube((x - 0.012, 0, high + 0.03), (x + 0.012, 0, high + 0.03), 0.034, 14))
        put("glass", tube((x - 0.013, 0, high + 0.03), (x + 0.013, 0, high + 0.03), 0.024, 12))
