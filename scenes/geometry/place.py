"""Places on the floor: where a piece stands and which way it faces."""

import numpy as np

from scenes.geometry.mesh import Vector

Place = tuple[float, float, float]
"""x, y in metres and yaw in radians, of a piece whose front is towards -y before the turn."""


def local(place: Place, dx: float, dy: float, turn_rad: float = 0.0) -> Place:
    """Return the place of something at (dx, dy) in a piece's own frame, turned further."""
    x, y, yaw = place
    c, s = np.cos(yaw), np.sin(yaw)
    return (float(x + c * dx - s * dy), float(y + s * dx + c * dy), yaw + turn_rad)


def extent(reach: Vector) -> tuple[float, float, float, float]:
    """Return x_min, y_min, x_max, y_max of `reach`: these, or (2,) half sizes about the origin."""
    x_min, y_min, x_max, y_max = reach if len(reach) == 4 else (*(-np.asarray(reach)), *reach)
    return float(x_min), float(y_min), float(x_max), float(y_max)
