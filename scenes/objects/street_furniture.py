"""What stands beside a road: tall lamps, traffic signs, hoardings and waste bins."""

import numpy as np

from scenes.geometry.mesh import box, polygons, tube
from scenes.pen import Pen, piece

SIGN_SIDES = {0: 3, 1: 24, 2: 24}
"""Number of corners of each cell of the atlas `signs`."""


@piece
def street_lamp(put: Pen, height_m: float) -> None:
    """Put a lamp on a pole, its arm towards -y before the turn."""
    put("steel", tube((0, 0, 0), (0, 0, 0.9), 0.085, 10))
    put("steel", tube((0, 0, 0.9), (0, 0, height_m), 0.06, 10, 0.7))
    put("steel", tube((0, 0.05, height_m - 0.05), (0, -1.2, height_m + 0.15), 0.04, 8))
    put("frame", box((0, -1.4, height_m + 0.14), (0.26, 0.75, 0.11), (0.5, 0.5), bottom=True))
    put.solid((0.16, 0.16, height_m))


@piece
def traffic_sign(put: Pen, kind: int) -> None:
    """Put a traffic sign, cell `kind` of the atlas `signs`, facing -y before the turn."""
    put("steel", tube((0, 0, 0), (0, 0, 2.75), 0.03, 8))
    sides = SIGN_SIDES[kind]
    turn = np.pi / 2 + 2 * np.pi * np.arange(sides) / sides
    radius = 0.52 if sides == 3 else 0.32
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for y, sense in ((-0.045, 1), (-0.035, -1)):
        face = np.column_stack([radius * rim[:, 0], 0 * turn + y, 2.45 + radius * rim[:, 1]])
        uv = 0.5 + 0.48 * rim * (1, -1)
        back = polygons(face[None, ::sense], uv[None, ::sense])
        if sense > 0:
            put("signs", back.textured(put.stage.atlases["signs"].rects[kind]))
        else:
            put("steel", back)
    put.solid((0.08, 0.08, 2.8))
    put.shade(2.45, (2 * radius, 0.02, 2 * radius), 0.9, (0, -0.04))


@piece
def hoarding(put: Pen, rng: np.random.Generator) -> None:
    """Put up a board of 2.6 x 1.9 m with a poster on two posts, facing -y before the turn."""
    for x in (-0.9, 0.9):
        put("concrete", box((x, 0.06, 1.6), (0.14, 0.14, 3.2), (1.2, 1.2)))
    put("frame", box((0, -0.03, 2.6), (2.7, 0.06, 2.0), (1.0, 1.0), bottom=True))
    put.cell("posters", rng, box((0, -0.075, 2.6), (2.5, 0.03, 1.8)))
    put("concrete", box((0, 0.06, 0.2), (2.6, 0.5, 0.4), (1.2, 1.2), rng.random(2)))
    put.solid((2.6, 0.5, 0.4), (0, 0.06))
    put.shade(2.6, (2.7, 0.08, 2.0))


@piece
def wheeled_bin(put: Pen, rng: np.random.Generator) -> None:
    """Put a waste bin of 0.58 x 0.7 x 1.07 m, its lid ajar."""
    put("rubber", box((0, 0, 0.52), (0.54, 0.62, 0.92), (0.5, 0.5), rng.random(2)))
    put("paint_1", box((0, -0.02, 1.02), (0.58, 0.7, 0.09), (0.5, 0.5), bottom=True))
    put.solid((0.56, 0.64, 1.04))
