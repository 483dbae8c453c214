"""Where between samples an extremum lies."""

import numpy as np

from vo.contract.arrays import Array


def peak(before: Array, centre: Array, after: Array) -> Array:
    """Offset in [-0.5, 0.5] of the vertex of the parabola through three equidistant samples."""
    curvature = before - 2 * centre + after
    slope = (before - after) / 2
    offset = np.divide(slope, curvature, out=np.zeros_like(slope), where=curvature != 0)
    return np.clip(offset, -0.5, 0.5)
