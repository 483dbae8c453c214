"""Wheel encoders: whole ticks of the wheel angles."""

import numpy as np

from vo.contract.arrays import Array, Indices


def ticks(wheel_angles_rad: Array, ticks_per_turn: int) -> Indices:
    """Quantise angles (...) to whole ticks, rounding down."""
    return np.floor(wheel_angles_rad / (2 * np.pi) * ticks_per_turn).astype(np.int64)
