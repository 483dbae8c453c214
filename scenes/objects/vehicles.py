"""Parked cars."""

import itertools

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged, polygons, tube
from scenes.pen import Pen, piece
from vo.contract.arrays import Array

PAINTS = ((168, 170, 172), (44, 46, 52), (206, 206, 202), (112, 36, 36), (44, 66, 98), (84, 96, 86))
LENGTH_M, WIDTH_M, HEIGHT_M = 4.2, 1.76, 1.46
BELT_M = 0.92
STATIONS = np.array([
    (-2.10, 0.70, 0.72, 0.72), (-2.04, 0.80, 0.86, 0.88), (-1.62, 0.87, 0.93, 1.02),
    (-1.10, 0.88, 0.94, 1.40), (-0.30, 0.88, 0.93, 1.46), (0.30, 0.88, 0.92, 1.44),
    (1.00, 0.88, 0.91, 0.98), (1.70, 0.85, 0.80, 0.86), (2.02, 0.78, 0.66, 0.70),
    (2.10, 0.68, 0.56, 0.58),
])  # fmt: skip
"""From tail to nose: x from the middle, half width, heights of the hood's edge and the roof."""
GLAZED = slice(2, 7)
"""Stations between which there are windows."""


@piece
def car(put: Pen, rng: np.random.Generator, paint: str) -> None:
    """Park a small hatchback, its nose towards +x before the turn.

    `paint` is the material of its body; `glass`, `rubber`, `iron` and `lamps` are used besides.
    """
    rings = _rings()
    put(paint, _skin(rings))
    put("glass", _windows(rings))
    for stuff, radius, wide in (
        ("rubber", 0.31, 0.23),
        ("iron", 0.19, 0.24),
        ("rubber", 0.37, 0.21),
    ):
        for x, y in itertools.product((-1.28, 1.28), (-0.78, 0.78)):
            put(stuff, _wheel(x, y, radius, wide))
    put("rubber", box((0, 0, 0.36), (3.9, 1.5, 0.3), bottom=True))
    for x, z in ((-2.085, 0.72), (2.02, 0.62)):
        for y in (-0.6, 0.6):
            put("lamps", box((x, y, z), (0.09, 0.26, 0.13), bottom=True))
        size = (0.12, 1.5, 0.17)
        put("rubber", box((1.025 * x, 0, 0.38), size, (0.5, 0.5), rng.random(2), bottom=True))
        put("plates", box((1.055 * x, 0, 0.42), (0.02, 0.5, 0.11), bottom=True))
    x, y, yaw = put.place
    put.stage.obstacle(put.name, (x, y, 0.75), (LENGTH_M, WIDTH_M, 1.4), yaw, shadow=False)
    put.shade((0.25 + BELT_M) / 2, (LENGTH_M - 0.3, 1.6, BELT_M - 0.25))
    put.shade((BELT_M + HEIGHT_M) / 2, (2.4, 1.6, HEIGHT_M - BELT_M), offset=(-0.35, 0.0))


def _rings() -> Array:
    """Outline every station from the left sill over the roof to the right: (S, 8, 3)."""
    x, half, hood, roof = STATIONS.T
    inner = half * np.where(roof - hood > 0.2, 0.74, 0.86)
    left = [(half * 0.93, 0.24 + 0 * x), (half, 0.55 * hood), (half * 0.97, hood), (inner, roof)]
    y = np.stack([v for v, _ in left] + [-v for v, _ in left[::-1]], axis=1)
    z = np.stack([h for _, h in left] + [h for _, h in left[::-1]], axis=1)
    return np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1)


def _skin(rings: Array) -> Mesh:
    """Close the body between the stations and at both ends."""
    a, b = rings[:-1], rings[1:]
    corners = np.stack([a[:, 1:], b[:, 1:], b[:, :-1], a[:, :-1]], axis=2).reshape(-1, 4, 3)
    ends = np.stack([rings[-1], rings[0][::-1]])
    sides = polygons(corners, corners[..., [0, 2]] / 1.5)
    return merged([sides, polygons(ends, ends[..., 1:] / 1.5)])


def _windows(rings: Array) -> Mesh:
    """Build panes a little proud of the skin: sides, front and back."""
    lit = rings[GLAZED]
    panes: list[Array] = []
    for a, b in itertools.pairwise(lit):
        panes += [np.array([a[2], a[3], b[3], b[2]]), np.array([b[5], b[4], a[4], a[5]])]
    panes += [np.array([lit[0][3], lit[0][4], lit[1][4], lit[1][3]])]
    panes += [np.array([lit[-2][3], lit[-2][4], lit[-1][4], lit[-1][3]])]
    made = np.array([_inset(p) for p in panes])
    return polygons(made, made[..., [0, 2]])


def _inset(pane: Array) -> Array:
    """Shrink a pane towards its middle and lift it off the skin, facing out and up."""
    normal = np.cross(pane[2] - pane[0], pane[3] - pane[1])
    normal /= np.linalg.norm(normal)
    middle = pane.mean(axis=0)
    out = normal @ (middle - np.array([middle[0], 0, 0.8])) > 0
    shrunk = middle + 0.86 * (pane - middle)
    return shrunk + 0.006 * normal if out else (shrunk - 0.006 * normal)[::-1]


def _wheel(x: float, y: float, radius_m: float, width_m: float) -> Mesh:
    half = width_m / 2 * np.array([0, 1, 0])
    middle = np.array([x, y, 0.31])
    return tube(middle - half, middle + half, radius_m, 18)
