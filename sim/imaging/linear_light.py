"""Grey levels and linear light: decoding of rendered images, encoding of a sensor's light."""

from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from scipy.special import ndtri

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

Response = Literal["srgb", "linear"]

ENCODING_BINS = 4096
"""Finer than the closest grey levels in linear light: each bin has at most one edge."""
QUANTILES = 1 << 16
"""Size of the table of normal quantiles: a look-up takes an eighth of the time of a new draw."""


def _srgb_to_linear(srgb: Array) -> Array:
    """IEC 61966-2-1, both 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


LINEAR: Array = _srgb_to_linear(np.arange(256) / 255).astype(np.float32)
"""(256,) float32 linear light, 0 to 1, of each level of a rendered (sRGB) image."""


def decode(image: Image) -> Array:
    """Return the linear light, float32 of 0 to 1, of a rendered (H, W[, 3]) uint8 image."""
    return np.asarray(cv2.LUT(image, LINEAR))


def levels_to_light(response: Response, levels: Array) -> Array:
    """Convert (fractional) grey levels 0 to 255 of a sensor, any shape, to linear light."""
    share = np.asarray(levels, np.float64) / 255
    return _srgb_to_linear(share) if response == "srgb" else share


def light_to_levels(response: Response, light: Array) -> Array:
    """Convert linear light, any shape, to fractional grey levels 0 to 255."""
    light = np.clip(light, 0, 1)
    if response == "linear":
        return 255 * light
    return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


class Encoding:
    """Conversion of linear light to the nearest grey level, by a table and one comparison."""

    def __init__(self, response: Response) -> None:
        self._response: Response = response
        edges = levels_to_light(response, np.arange(255) + 0.5)
        self._edges = np.append(edges, np.inf).astype(np.float32)
        light = levels_to_light(response, np.arange(256))
        self._light, self._slope = light.astype(np.float32), np.gradient(light).astype(np.float32)
        starts = np.arange(ENCODING_BINS + 1) / np.float32(ENCODING_BINS)
        self._first = np.searchsorted(self._edges, starts, side="right").astype(np.uint8)

    def __call__(self, light: Array) -> Image:
        """Encode (H, W[, 3]) float32 light; values outside [0, 1] are clipped."""
        out = np.empty(light.shape, np.uint8)
        _encode(light.ravel(), self._edges, self._first, out.reshape(-1))
        return out

    def encode_noisy(
        self, light: Array, shot: float, floor: float, rng: np.random.Generator
    ) -> Image:
        """Encode (H, W[, 3]) light with normal noise of variance shot * light + floor added."""
        out = np.empty(light.shape, np.uint8)
        drawn = rng.integers(0, QUANTILES, light.size, dtype=np.uint16)
        noise = np.float32(shot), np.float32(floor), drawn, normal_quantiles()
        _encode_noisy(light.ravel(), *noise, self._edges, self._first, out.reshape(-1))
        return out

    def encode_deep(
        self, light: Array, bits: int, noise: tuple[float, float, np.random.Generator] | None
    ) -> Array:
        """Encode (H, W[, 3]) light as uint16 levels up to 2^bits - 1; noise as `encode_noisy`."""
        light = np.maximum(light, 0)
        if noise:
            shot, floor, rng = noise
            drawn = normal_quantiles()[rng.integers(0, QUANTILES, light.shape, dtype=np.uint16)]
            light = light + np.sqrt(shot * light + floor) * drawn
        levels = light_to_levels(self._response, light) * ((2**bits - 1) / 255)
        return np.rint(levels).astype(np.uint16)

    def rescale(self, image: Image, share: Array) -> tuple[Array, Array]:
        """Divide the light of an image (H, W[, 3]) by a share (H, W) of it, float32.

        Returns:
            Fractional grey levels up to 255, and the factor on small differences of levels, in
                the shape of the image, float32. Between grey levels, light is taken as linear.
        """
        levels, factor = np.empty((2, *image.shape), np.float32)
        channels = image.shape[2] if image.ndim == 3 else 1
        pixels, out, factors = (x.reshape(-1, channels) for x in (image, levels, factor))
        tables = self._light, self._slope, self._first
        _rescale(share.ravel(), pixels, out, factors, *tables)
        return levels, factor


@lru_cache(maxsize=1)
def normal_quantiles() -> Array:
    """Return (QUANTILES,) float32 equally probable values of a standard normal variable, read-only.

    They reach to 4.3; mean 0, variance 1, kurtosis 2.999.
    """
    quantiles = ndtri((np.arange(QUANTILES) + 0.5) / QUANTILES)
    table = (quantiles / quantiles.std()).astype(np.float32)
    table.flags.writeable = False
    return table


@compiled(nogil=True)
def _level(light: np.float32, edges: Array, first: Array) -> int:
    """Return the nearest grey level: the bin's first, or the next beyond the bin's edge."""
    light = min(max(light, np.float32(0)), np.float32(1))
    level = first[int(light * np.float32(ENCODING_BINS))]
    return level + (light >= edges[level])


@compiled(nogil=True)
def _encode(light: Array, edges: Array, first: Array, out: Image) -> None:
    for i in range(len(light)):
        out[i] = _level(light[i], edges, first)


@compiled(nogil=True)
def _encode_noisy(
    light: Array,
    shot: np.float32,
    floor: np.float32,
    drawn: Array,
    quantiles: Array,
    edges: Array,
    first: Array,
    out: Image,
) -> None:
    for i in range(len(light)):
        y = max(light[i], np.float32(0))
        out[i] = _level(y + np.sqrt(shot * y + floor) * quantiles[drawn[i]], edges, first)


@compiled(nogil=True)
def _rescale(
    share: Array,
    image: Image,
    levels: Array,
    factor: Array,
    light: Array,
    slope: Array,
    first: Array,
) -> None:
    for i in range(len(share)):
        for c in range(image.shape[1]):
            level = image[i, c]
            wanted = min(light[level] / share[i], np.float32(1))
            low = min(int(first[int(wanted * np.float32(ENCODING_BINS))]), 254)
            while low > 0 and light[low] > wanted:
                low -= 1
            while low < 254 and light[low + 1] <= wanted:
                low += 1
            rest = (wanted - light[low]) / (light[low + 1] - light[low])
            after = slope[low] + rest * (slope[low + 1] - slope[low])
            levels[i, c] = np.float32(low) + rest
            factor[i, c] = slope[level] / (share[i] * after)
