"""Rooms: where their walls stand."""

import numpy as np

from scenes.objects.furniture import Place
from vo.contract.arrays import Array


def sides(half: Array, centre: tuple[float, float] = (0.0, 0.0)) -> list[tuple[Place, float]]:
    """List a rectangular room's walls: north, east, south, west.

    Args:
        half: (2,) half sizes, metres.
        centre: Of the room.

    Returns:
        For each wall its place and length in metres: x runs along the wall from the place, -y
        points into the room, as for the backs of furniture.
    """
    x, y = half
    cx, cy = centre
    return [
        ((cx - x, cy + y, 0.0), 2 * x),
        ((cx + x, cy + y, -np.pi / 2), 2 * y),
        ((cx + x, cy - y, np.pi), 2 * x),
        ((cx - x, cy - y, np.pi / 2), 2 * y),
    ]
