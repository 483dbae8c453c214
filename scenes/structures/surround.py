"""Enclosures of a court: brick and plaster walls, and kerbs."""

from collections.abc import Sequence

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, polygons
from scenes.pen import Pen, Place, piece
from scenes.stage import Stage
from vo.contract.arrays import Array

COURSE_M = 0.075
STRETCHER_M = 0.22
PROUD_M = 0.006
"""Height of bricks over their mortar and of posters over their wall."""
THICKNESS_M = 0.24


@piece
def brick_wall(put: Pen, rng: np.random.Generator, length_m: float, height_m: float) -> None:
    """Build a wall along x from a place; bricks show on its right-hand side."""
    middle = (length_m / 2, THICKNESS_M / 2, height_m / 2)
    put("mortar", box(middle, (length_m, THICKNESS_M, height_m), (1.0, 1.0), rng.random(2)))
    courses, columns = int(height_m / COURSE_M), int(length_m / STRETCHER_M)
    row, column = (a.ravel() for a in np.mgrid[:courses, :columns])
    left = (column + 0.5 * (row % 2)) * STRETCHER_M + rng.normal(0, 0.0015, row.size)
    right = np.minimum(left + STRETCHER_M - 0.01, length_m)
    low = row * COURSE_M + 0.008
    high = low + COURSE_M - 0.011 + rng.normal(0, 0.0008, row.size)
    face = np.full(row.size, -PROUD_M) + rng.normal(0, 0.0012, row.size)
    rim = ((left, low), (right, low), (right, high), (left, high))
    corners = np.stack([np.stack([x, face, z], axis=1) for x, z in rim], axis=1)
    cell = put.stage.atlases["wall_bricks"].pick(rng, row.size)
    flip = rng.random(row.size) < 0.5
    u0, u1 = np.where(flip, cell[:, 2], cell[:, 0]), np.where(flip, cell[:, 0], cell[:, 2])
    u1 = u0 + (u1 - u0) * (right - left) / (STRETCHER_M - 0.01)
    v0, v1 = cell[:, 1], cell[:, 3]
    uv = np.stack([np.stack(c, axis=1) for c in ((u0, v1), (u1, v1), (u1, v0), (u0, v0))], axis=1)
    put("wall_bricks", polygons(corners, uv))
    middle = (length_m / 2, THICKNESS_M / 2, height_m + 0.04)
    put("concrete", box(middle, (length_m + 0.04, 0.32, 0.08), (1.2, 1.2)))
    put.solid((length_m, THICKNESS_M, height_m), (length_m / 2, THICKNESS_M / 2))


@piece
def plaster_wall(put: Pen, rng: np.random.Generator, length_m: float, height_m: float) -> None:
    """Build a rendered wall on a concrete plinth; sides as in `brick_wall`."""
    middle, size = (length_m / 2, THICKNESS_M / 2), (length_m, THICKNESS_M, height_m)
    put("plaster", box((*middle, height_m / 2), size, (8.0, height_m), (rng.random(), 0)))
    plinth = box((length_m / 2, 0.1, 0.11), (length_m, 0.24, 0.22), (1.2, 1.2), rng.random(2))
    put("concrete", plinth)
    put.solid((length_m, THICKNESS_M, height_m), (length_m / 2, THICKNESS_M / 2))


def hang_posters(
    stage: Stage, rng: np.random.Generator, wall: Place, spots: Sequence[Vector]
) -> None:
    """Hang posters on a wall's right-hand side, no two alike while there are enough.

    Each spot is left edge, lower edge, width and height in metres along and up the wall.
    """
    atlas, put = stage.atlases["posters"], Pen(stage, wall)
    choice = rng.permutation(atlas.count)
    for i, (x, z, w, h) in enumerate(spots):
        sheet = box((x + w / 2, -PROUD_M - 0.006, z + h / 2), (w, 0.008, h), cell_m=0.3)
        put("posters", sheet.textured(atlas.rects[choice[i % atlas.count]]))


def kerb(rng: np.random.Generator, half: Array, width_m: float, height_m: float) -> list[Mesh]:
    """Edge a paving of (2,) half sizes with kerbstones about 1 m long."""
    stones: list[Mesh] = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        run = 2 * half[1 - axis] + (2 * width_m if axis else 0)
        count = round(run)
        pitch = run / count
        for k in range(count):
            along = -run / 2 + (k + 0.5) * pitch
            across = sign * (half[axis] + width_m / 2)
            stone = (pitch - 0.006, width_m - 0.004)
            centre = (along, across) if axis else (across, along)
            size = stone if axis else stone[::-1]
            top = height_m + rng.normal(0, 0.0015)
            stones.append(box((*centre, top / 2), (*size, top), (1.2, 1.2), rng.random(2), 0.34))
    return stones
