"""What is on the front of a lens: dust, drops and fingerprints, out of focus.

Dust takes light. Drops and fingerprints scatter it: a share of each pixel's light is replaced by
that of a wide surround.

Source: the model of scattering and attenuation is that of Gu et al., Removing image artifacts due
to dirty camera lenses and thin occluders, 2009; sizes and shares are chosen.
"""

import math

import cv2
import numpy as np

from vo.contract.arrays import Array

DUST, DROPS, PRINTS = 60, 14, 1.5
"""Number of specks, of drops and of fingerprints on a lens at soiling 1."""
DUST_SIZE, DROP_SIZE, PRINT_SIZE = (0.004, 0.02), (0.015, 0.06), (0.12, 0.22)
"""Smallest and largest radius, as a fraction of the image's width."""
DUST_OPACITY, DROP_SHARE, PRINT_SHARE = 0.6, 0.85, 0.6
EDGE = 0.35
"""Width of the blurred outline of a speck or drop, as a fraction of its radius."""
SURROUND = 0.04
"""Standard deviation of scattered light, as a fraction of the image's width."""
SCALED = 8
"""Factor by which the image is reduced for its surround."""


class Soiling:
    """Dirt on one lens, in the size (H, W) of its raw images with their margin."""

    def __init__(self, amount: float, shape: tuple[int, int], rng: np.random.Generator) -> None:
        """Draw dirt: as often as `amount` says, in places and sizes of the generator."""
        height, width = shape
        self._passed, self._scattered = np.ones(shape, np.float32), np.zeros(shape, np.float32)
        v, u = np.mgrid[:height, :width].astype(np.float32) / np.float32(width)
        for k in range(rng.poisson(DUST * amount)):
            spot = _spot(u, v, rng, DUST_SIZE, 0.3 if k % 8 == 0 else 0.0)
            self._passed *= 1 - np.float32(DUST_OPACITY * rng.uniform(0.3, 1)) * spot
        for _ in range(rng.poisson(DROPS * amount)):
            spot = _spot(u, v, rng, DROP_SIZE, 0.15)
            self._scattered = np.maximum(self._scattered, np.float32(DROP_SHARE) * spot)
        for _ in range(rng.poisson(PRINTS * amount)):
            print_ = _spot(u, v, rng, PRINT_SIZE, 0.25) * _ridges(u, v, rng)
            self._scattered = np.maximum(self._scattered, np.float32(PRINT_SHARE) * print_)

    def __call__(self, light: Array) -> Array:
        """Return linear light (H, W[, 3]) float32 behind the dirt."""
        passed, scattered = self._passed, self._scattered
        if light.ndim == 3:
            passed, scattered = passed[..., None], scattered[..., None]
        return passed * (light + scattered * (_surround(light) - light))


def _spot(
    u: Array, v: Array, rng: np.random.Generator, sizes: tuple[float, float], stretch: float
) -> Array:
    """Return a disc of 1 with a soft outline, somewhere in the image; lengths are of its width."""
    centre = rng.uniform(0, [float(u.max()), float(v.max())])
    radius, turn = math.exp(rng.uniform(*np.log(sizes))), rng.uniform(0, math.pi)
    x, y = u - np.float32(centre[0]), v - np.float32(centre[1])
    along = np.float32(math.cos(turn)) * x + np.float32(math.sin(turn)) * y
    across = np.float32(math.cos(turn)) * y - np.float32(math.sin(turn)) * x
    distance = np.hypot(along / np.float32(1 + stretch), across) / np.float32(radius)
    return np.clip((1 - distance) / np.float32(EDGE) + np.float32(0.5), 0, 1)


def _ridges(u: Array, v: Array, rng: np.random.Generator) -> Array:
    """Return the ridges of a finger, 0.3 to 1: circles around a point beside it, with bends."""
    x0, y0 = rng.uniform(-0.2, 1.2, 2)
    radius = np.hypot(u - np.float32(x0), v - np.float32(y0))
    bend = np.float32(0.01) * np.sin(18 * u + np.float32(rng.uniform(0, 6))) * np.cos(14 * v)
    phase = (radius + bend) * np.float32(2 * math.pi * 70)
    return np.float32(0.65) + np.float32(0.35) * np.sin(phase)


def _surround(light: Array) -> Array:
    height, width = light.shape[:2]
    small = cv2.resize(light, None, fx=1 / SCALED, fy=1 / SCALED, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), SURROUND * width / SCALED)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR))
