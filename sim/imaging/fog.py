"""Fog: light that is lost on the way from a surface, and light of the air that replaces it."""

import math

import numpy as np

from sim.imaging.linear_light import decode
from vo.contract.arrays import Array

AIRLIGHT = 0.6
"""Linear light of fog without end, over that of the brightest level."""
CONTRAST = 0.05
"""Contrast that remains at the visibility."""


def foggy(light: Array, range_m: Array, visibility_m: float) -> Array:
    """Return the linear light, float32, of an image (H, W[, 3]) in fog.

    The image is linear light, or uint8 as rendered; the distances (H, W) along the rays are NaN for
    the sky, which fog hides.

    Source: Koschmieder's law: L = L0 t + A (1 - t), t = exp(-b d), b = ln(1 / 0.05) / visibility.
    """
    light = decode(light) if light.dtype == np.uint8 else light
    passed = np.exp(np.float32(math.log(CONTRAST) / visibility_m) * np.nan_to_num(range_m, nan=1e9))
    passed = passed.astype(np.float32)[(...,) + (None,) * (light.ndim - 2)]
    return light * passed + np.float32(AIRLIGHT) * (1 - passed)
