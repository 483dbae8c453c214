"""Houses along a street: recessed windows, shutters, balconies, doors and pitched roofs."""

import numpy as np

from scenes.geometry.mesh import Mesh, box, boxes, merged, patch, polygons
from scenes.pen import Pen, piece
from vo.contract.arrays import Array

DEPTH_M = 9.0
STOREY_M = 2.8
PLINTH_M = 0.4
RECESS_M = 0.16
WALL_PERIOD_M = 4.0
"""Metres of wall that its texture covers."""
WINDOWS_M = ((1.1, 1.45, 0.85), (0.95, 1.6, 0.75), (1.7, 1.4, 0.9))
"""Width and height of windows, and the height of their sills above the floor."""
DOOR_M = (1.15, 2.2)
BAR_M = 0.07


@piece
def house(put: Pen, rng: np.random.Generator, length_m: float, storeys: int, wall: str) -> None:
    """Build a house from a place along its front, which is seen from its right-hand side.

    `wall` is the material of its walls; `panes`, `slats`, `frame`, `door`, `concrete`, `iron` and
    `tiles` are used besides.
    """
    height = PLINTH_M + storeys * STOREY_M
    middles, windows, door = _openings(rng, length_m, storeys)
    openings = np.concatenate([windows, door])
    put(wall, merged([_front(length_m, height, openings), _sides(length_m, height)]))
    put(wall, _reveals(openings))
    put("panes", _glazed(put, rng, windows))
    put("frame", merged([_bars(windows), boxes(*_surround(door))]))
    put("door", _flat(door, RECESS_M))
    put("concrete", boxes(*_sills(windows)))
    closed = rng.random(len(windows)) < 0.4
    shut = windows[closed]
    shut[:, 2] = shut[:, 3] - rng.choice((0.25, 0.5, 1.0), len(shut)) * (shut[:, 3] - shut[:, 2])
    if len(shut):
        put("slats", _flat(shut, RECESS_M - 0.06, 0.8))
    foot = (length_m / 2, -0.02, PLINTH_M / 2)
    put("concrete", box(foot, (length_m + 0.04, 0.06, PLINTH_M), (1.2, 1.2), rng.random(2), 1.0))
    _entrance(put, door)
    if storeys > 1:
        _balconies(put, rng, middles, storeys)
    _roof(put, length_m, height, wall, rise_m=float(rng.uniform(2.2, 3.4)))
    put.solid((length_m, DEPTH_M, height), (length_m / 2, DEPTH_M / 2))


def _openings(
    rng: np.random.Generator, length_m: float, storeys: int
) -> tuple[Array, Array, Array]:
    """Choose the middles of bays, windows (N, 4) and the door (1, 4): x0, x1, z0, z1."""
    wide, high, sill = WINDOWS_M[rng.integers(len(WINDOWS_M))]
    bays = max(3, round(length_m / rng.uniform(1.5, 1.8) / wide**0.5))
    middles = (np.arange(bays) + 0.5) * length_m / bays
    entrance = int(rng.integers(bays))
    k, row = (x.ravel() for x in np.meshgrid(np.arange(bays), np.arange(storeys)))
    k, row = (x[(k != entrance) | (row > 0)] for x in (k, row))
    low = PLINTH_M + row * STOREY_M + sill
    windows = np.column_stack([middles[k] - wide / 2, middles[k] + wide / 2, low, low + high])
    half = DOOR_M[0] / 2
    door = (middles[entrance] - half, middles[entrance] + half, 0.16, 0.16 + DOOR_M[1])
    return middles, windows, np.array([door])


def _front(length_m: float, height_m: float, openings: Array) -> Mesh:
    """Lay the front around its openings in quads, which share no edge with a larger one."""
    x, z = (
        np.unique(np.concatenate([np.linspace(0, end, int(end) + 1), cuts.ravel()]).round(4))
        for end, cuts in ((length_m, openings[:, :2]), (height_m, openings[:, 2:]))
    )
    x0, z0 = (v.ravel() for v in np.meshgrid(x[:-1], z[:-1], indexing="ij"))
    x1, z1 = (v.ravel() for v in np.meshgrid(x[1:], z[1:], indexing="ij"))
    mx, mz = ((x0 + x1) / 2)[:, None], ((z0 + z1) / 2)[:, None]
    inside = (mx > openings[:, 0]) & (mx < openings[:, 1])
    inside &= (mz > openings[:, 2]) & (mz < openings[:, 3])
    solid = ~inside.any(axis=1)
    return _flat(np.column_stack([x0, x1, z0, z1])[solid], 0.0, WALL_PERIOD_M)


def _flat(rects: Array, y: float, texture_m: float = 1.0) -> Mesh:
    """Build upright rectangles, (N, 4) x0, x1, z0, z1, that face the street at a depth."""
    x0, x1, z0, z1 = rects.T
    rim = ((x0, z0), (x1, z0), (x1, z1), (x0, z1))
    corners = np.stack([np.column_stack([x, 0 * x + y, z]) for x, z in rim], axis=1)
    return polygons(corners, corners[..., [0, 2]] * (1, -1) / texture_m)


def _sides(length_m: float, height_m: float) -> Mesh:
    cells, period = (6, 6), (WALL_PERIOD_M, WALL_PERIOD_M)
    deep, up = (0, DEPTH_M, 0), (0, 0, height_m)
    left = patch((0, DEPTH_M, 0), (0, -DEPTH_M, 0), up, cells, period)
    return merged([left, patch((length_m, 0, 0), deep, up, cells, period)])


def _reveals(openings: Array) -> Mesh:
    """Line the openings from the front to the glass."""
    x0, x1, z0, z1 = openings.T
    f, d = 0 * x0, 0 * x0 + RECESS_M
    sides = (
        ((x0, f, z0), (x0, d, z0), (x0, d, z1), (x0, f, z1)),
        ((x1, d, z0), (x1, f, z0), (x1, f, z1), (x1, d, z1)),
        ((x0, f, z0), (x1, f, z0), (x1, d, z0), (x0, d, z0)),
        ((x0, d, z1), (x1, d, z1), (x1, f, z1), (x0, f, z1)),
    )
    corners = np.concatenate([np.stack([np.stack(c, axis=-1) for c in s], axis=1) for s in sides])
    return polygons(corners, corners[..., [0, 2]] / WALL_PERIOD_M)


def _glazed(put: Pen, rng: np.random.Generator, windows: Array) -> Mesh:
    mesh = _flat(windows, RECESS_M)
    cells = put.stage.atlases["panes"].pick(rng, len(windows))
    u0, v0, u1, v1 = cells.T
    uv = np.stack([np.stack(c, axis=-1) for c in ((u0, v1), (u1, v1), (u1, v0), (u0, v0))], axis=1)
    return Mesh(mesh.points, mesh.normals, uv.reshape(-1, 2), mesh.faces)


def _bars(windows: Array) -> Mesh:
    """Frame every window, with a bar in its middle and one across."""
    x0, x1, z0, z1 = windows.T
    middle, across = (x0 + x1) / 2, z0 + 0.7 * (z1 - z0)
    rects = [
        (x0, x0 + BAR_M, z0, z1), (x1 - BAR_M, x1, z0, z1),
        (x0 + BAR_M, x1 - BAR_M, z0, z0 + BAR_M), (x0 + BAR_M, x1 - BAR_M, z1 - BAR_M, z1),
        (middle - BAR_M / 2, middle + BAR_M / 2, z0 + BAR_M, z1 - BAR_M),
        (x0 + BAR_M, middle - BAR_M / 2, across, across + 0.05),
        (middle + BAR_M / 2, x1 - BAR_M, across, across + 0.05),
    ]  # fmt: skip
    return _flat(np.concatenate([np.column_stack(r) for r in rects]), RECESS_M - 0.04)


def _surround(door: Array) -> tuple[Array, Array]:
    """Return both corners (2, 3) of the posts beside a door."""
    x0, x1, z0, z1 = door[0]
    lows = np.array([(x0 - 0.14, -0.04, z0), (x1, -0.04, z0)])
    return lows, lows + np.array([0.14, 0.08, z1 - z0])


def _sills(windows: Array) -> tuple[Array, Array]:
    x0, x1, z0, _ = windows.T
    low = np.column_stack([x0 - 0.08, 0 * x0 - 0.12, z0 - 0.07])
    return low, np.column_stack([x1 + 0.08, 0 * x0 + RECESS_M - 0.05, z0])


def _entrance(put: Pen, door: Array) -> None:
    """Put a step in front of the door and a canopy over it."""
    x = float(door[0, :2].mean())
    put("concrete", box((x, -0.35, 0.08), (1.6, 0.7, 0.16), (1.2, 1.2)))
    put("iron", box((x, -0.5, 2.62), (1.9, 1.0, 0.1), (0.5, 0.5), bottom=True))
    put.shade(2.62, (1.9, 1.0, 0.1), 1.0, (x, -0.5))


def _balconies(put: Pen, rng: np.random.Generator, middles: Array, storeys: int) -> None:
    """Hang one or two balconies with railings of bars from the upper storeys."""
    for _ in range(int(rng.integers(3))):
        x, floor = float(rng.choice(middles)), PLINTH_M + int(rng.integers(1, storeys)) * STOREY_M
        put("concrete", box((x, -0.55, floor), (2.3, 1.1, 0.16), (1.2, 1.2), bottom=True))
        along = np.arange(x - 1.1, x + 1.11, 0.11)
        low = np.column_stack([along, 0 * along - 1.08, 0 * along + floor])
        put("iron", boxes(low, low + np.array([0.025, 0.025, 0.95])))
        put("iron", box((x, -1.07, floor + 0.97), (2.3, 0.06, 0.05), (0.5, 0.5), bottom=True))
        put.shade(floor, (2.3, 1.1, 0.16), 1.0, (x, -0.55))
        put.shade(floor + 0.5, (2.3, 0.04, 0.95), 0.3, (x, -1.07))


def _roof(put: Pen, length_m: float, height_m: float, wall: str, rise_m: float) -> None:
    """Pitch a roof over the house, its ridge along the front, and close its gables."""
    half, over = DEPTH_M / 2, 0.35
    fall = over * rise_m / half
    ends = np.array([-over, length_m + over])
    front = [(ends[0], -over), (ends[1], -over), (ends[1], half), (ends[0], half)]
    back = [(ends[1], 2 * half + over), (ends[0], 2 * half + over), front[3], front[2]]
    z = (height_m - fall, height_m - fall, height_m + rise_m, height_m + rise_m)
    corners = np.array([[(*xy, h) for xy, h in zip(s, z, strict=True)] for s in (front, back)])
    uv = np.array(
        [
            [(x / 3, -k * (half + over) / 3 / 0.85) for x, k in zip(s, (0, 0, 1, 1), strict=True)]
            for s in (corners[0, :, 0], corners[1, :, 0])
        ]
    )
    put("tiles", polygons(corners, uv))
    put(
        "frame",
        box(
            (length_m / 2, -over, height_m - fall - 0.05),
            (length_m + 0.7, 0.1, 0.16),
            (1, 1),
            bottom=True,
        ),
    )
    gables = np.array(
        [
            [(0, 2 * half, height_m), (0, 0, height_m), (0, half, height_m + rise_m)],
            [
                (length_m, 0, height_m),
                (length_m, 2 * half, height_m),
                (length_m, half, height_m + rise_m),
            ],
        ]
    )
    put(wall, polygons(gables, gables[..., 1:] * (1, -1) / WALL_PERIOD_M))
    put.shade(
        height_m + rise_m / 4, (length_m, 0.6 * DEPTH_M, rise_m / 2), 1.0, (length_m / 2, half)
    )
