"""House fronts: windows, doors and sills on rendered walls."""

import numpy as np

from scenes.geometry.mesh import box, patch
from scenes.pen import Pen, piece

DEPTH_M = 0.4
PLINTH_M = 0.5
BAY_M = 1.9
"""Mean distance from one window's middle to the next."""
STOREY_M = 2.9
FIRST_SILL_M = 1.0
WINDOW_M = (0.95, 1.4)


@piece
def facade(
    put: Pen, rng: np.random.Generator, length_m: float, storeys: int, plaster: str, wood: str
) -> None:
    """Build a house front from a place along its length; it is seen from its right-hand side.

    `plaster` and `wood` are the materials of the wall and of frames, shutters and the door;
    `glass`, `concrete` and `roof` are used besides.
    """
    height = storeys * STOREY_M + 0.5
    cells = (int(length_m / 0.4), int(height / 0.4))
    shift = rng.random(2) * (1, 0)
    put(plaster, patch((0, 0, 0), (length_m, 0, 0), (0, 0, height), cells, (8.0, height), shift))
    for x in (0.0, length_m):
        quoin = (0.34, 0.06, height)
        put("concrete", box((x, -0.02, height / 2), quoin, (1.2, 1.2), rng.random(2)))
    plinth = (length_m, 0.08, PLINTH_M)
    put("concrete", box((length_m / 2, -0.01, PLINTH_M / 2), plinth, (1.2, 1.2), rng.random(2)))
    eaves = (length_m + 0.4, 0.5, 0.14)
    put("roof", box((length_m / 2, -0.12, height + 0.07), eaves, (1.0, 1.0), bottom=True))
    bays = max(3, round(length_m / BAY_M))
    door_bay = int(rng.choice((1, bays - 2)))
    for row in range(storeys):
        for k in range(bays):
            x = (k + 0.5) * length_m / bays
            if row == 0 and k == door_bay:
                _door(put, rng, x, wood)
            else:
                shuttered = row > 0 and rng.random() < 0.7
                _window(put, rng, x, FIRST_SILL_M + row * STOREY_M, wood, shuttered)
    put.solid((length_m, DEPTH_M, height), (length_m / 2, DEPTH_M / 2))


def _window(
    put: Pen, rng: np.random.Generator, x: float, sill_m: float, wood: str, shuttered: bool
) -> None:
    wide, high = WINDOW_M
    middle = sill_m + high / 2
    put("glass", box((x, -0.004, middle), (wide, 0.008, high), (1.0, 1.0), rng.random(2)))
    for dx in (-wide / 2, 0.0, wide / 2):
        put(wood, box((x + dx, -0.02, middle), (0.06, 0.04, high), (0.8, 0.8), rng.random(2)))
    for dz in (-high / 2, 0.18 * high, high / 2):
        bar = box((x, -0.022, middle + dz), (wide + 0.06, 0.045, 0.06), (0.8, 0.8), bottom=True)
        put(wood, bar)
    sill = box((x, -0.08, sill_m - 0.05), (wide + 0.3, 0.16, 0.07), (1.2, 1.2), bottom=True)
    put("concrete", sill)
    if not shuttered:
        return
    for side in (-1, 1):
        at_x = x + side * (0.75 * wide + 0.06)
        put(wood, box((at_x, -0.025, middle), (0.5 * wide, 0.03, high), (0.8, 0.8), rng.random(2)))
        for z in np.arange(-0.42, 0.43, 0.12) * high:
            put("glass", box((at_x, -0.042, middle + z), (0.4 * wide, 0.004, 0.05)))


def _door(put: Pen, rng: np.random.Generator, x: float, wood: str) -> None:
    put(wood, box((x, -0.03, 1.1), (1.1, 0.05, 2.2), (0.8, 0.8), rng.random(2)))
    for dx in (-0.26, 0.26):
        for z, high in ((0.55, 0.7), (1.5, 0.9)):
            put("roof", box((x + dx, -0.058, z), (0.36, 0.008, high), (0.8, 0.8), rng.random(2)))
    for side in (-1, 1):
        put("concrete", box((x + 0.65 * side, -0.05, 1.15), (0.2, 0.12, 2.3), (1.2, 1.2)))
    put("concrete", box((x, -0.06, 2.38), (1.6, 0.16, 0.24), (1.2, 1.2), bottom=True))
    put("concrete", box((x, -0.22, 0.06), (1.6, 0.4, 0.12), (1.2, 1.2)))
