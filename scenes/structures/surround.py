"""What encloses a court: brick and plaster walls, kerb, lawn and gravel."""

from collections.abc import Sequence

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, polygons
from scenes.stage import Stage, one_object
from scenes.surfaces.atlas import Atlas
from vo.contract.arrays import Array

COURSE_M = 0.075
STRETCHER_M = 0.22
PROUD_M = 0.006  # of bricks over their mortar, of posters over their wall


@one_object
def brick_wall(
    stage: Stage,
    name: str,
    rng: np.random.Generator,
    atlas: Atlas,
    start: Vector,
    length_m: float,
    height_m: float,
    yaw_rad: float,
) -> None:
    """Build a wall from (2,) `start` along `yaw_rad`; bricks show on its right-hand side."""
    thickness = 0.24
    place = (start[0], start[1], 0.0)
    middle = (length_m / 2, thickness / 2, height_m / 2)
    core = box(middle, (length_m, thickness, height_m), (1.0, 1.0), rng.random(2))
    stage.draw("mortar", core.moved(place, yaw_rad))
    courses, columns = int(height_m / COURSE_M), int(length_m / STRETCHER_M)
    row, column = (a.ravel() for a in np.mgrid[:courses, :columns])
    left = (column + 0.5 * (row % 2)) * STRETCHER_M + rng.normal(0, 0.0015, row.size)
    right = np.minimum(left + STRETCHER_M - 0.01, length_m)
    low = row * COURSE_M + 0.008
    high = low + COURSE_M - 0.011 + rng.normal(0, 0.0008, row.size)
    face = np.full(row.size, -PROUD_M) + rng.normal(0, 0.0012, row.size)
    corners = np.stack(
        [
            np.stack([left, face, low], axis=1),
            np.stack([right, face, low], axis=1),
            np.stack([right, face, high], axis=1),
            np.stack([left, face, high], axis=1),
        ],
        axis=1,
    )
    cell = atlas.rects[rng.integers(atlas.count, size=row.size)]
    flip = rng.random(row.size) < 0.5
    u0, u1 = np.where(flip, cell[:, 2], cell[:, 0]), np.where(flip, cell[:, 0], cell[:, 2])
    u1 = u0 + (u1 - u0) * (right - left) / (STRETCHER_M - 0.01)
    v0, v1 = cell[:, 1], cell[:, 3]
    uv = np.stack([np.stack(c, axis=1) for c in ((u0, v1), (u1, v1), (u1, v0), (u0, v0))], axis=1)
    stage.draw("wall_bricks", polygons(corners, uv).moved(place, yaw_rad))
    coping = box(
        (length_m / 2, thickness / 2, height_m + 0.04), (length_m + 0.04, 0.32, 0.08), (1.2, 1.2)
    )
    stage.draw("concrete", coping.moved(place, yaw_rad))
    _collide(stage, name, start, length_m, thickness, height_m, yaw_rad)


@one_object
def plaster_wall(
    stage: Stage,
    name: str,
    rng: np.random.Generator,
    start: Vector,
    length_m: float,
    height_m: float,
    yaw_rad: float,
) -> None:
    """Build a rendered wall on a concrete plinth; sides as in `brick_wall`."""
    thickness, place = 0.24, (start[0], start[1], 0.0)
    size = (length_m, thickness, height_m)
    wall = box(
        (length_m / 2, thickness / 2, height_m / 2), size, (8.0, height_m), (rng.random(), 0)
    )
    stage.draw("plaster", wall.moved(place, yaw_rad))
    plinth = box((length_m / 2, 0.1, 0.11), (length_m, 0.24, 0.22), (1.2, 1.2), rng.random(2))
    stage.draw("concrete", plinth.moved(place, yaw_rad))
    _collide(stage, name, start, length_m, thickness, height_m, yaw_rad)


def on_wall(
    rng: np.random.Generator,
    atlas: Atlas,
    start: Vector,
    yaw_rad: float,
    spots: Sequence[tuple[float, float, float, float]],
) -> list[Mesh]:
    """Hang pictures on a wall's right-hand side.

    Args:
        rng: Chooses the pictures, no two alike while there are enough.
        atlas: The pictures.
        start: (2,) as for the wall.
        yaw_rad: As for the wall.
        spots: Left edge, lower edge, width and height of each, metres along and up the wall.
    """
    choice = rng.permutation(atlas.count)
    return [
        box((x + w / 2, -PROUD_M - 0.006, z + h / 2), (w, 0.008, h), cell_m=0.3)
        .textured(atlas.rects[choice[i % atlas.count]])
        .moved((start[0], start[1], 0.0), yaw_rad)
        for i, (x, z, w, h) in enumerate(spots)
    ]


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


def _collide(
    stage: Stage,
    name: str,
    start: Vector,
    length_m: float,
    thickness_m: float,
    height_m: float,
    yaw_rad: float,
) -> None:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = length_m / 2, thickness_m / 2
    centre = (start[0] + c * x - s * y, start[1] + s * x + c * y, height_m / 2)
    stage.obstacle(name, centre, (length_m, thickness_m, height_m), yaw_rad)
