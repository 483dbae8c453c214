"""Grey levels and linear light: decoding of rendered images, encoding of a sensor's light."""

from functools import lru_cache
from typing import Literal, NamedTuple

import cv2
import numpy as np
from scipy.special import ndtri

from sim.camera_settings import SensorSettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

Response = Literal["srgb", "linear"]


class Curve(NamedTuple):
    """Grey levels of light: response, then an exponent, then the levels of no and of full light."""

    response: Response = "srgb"
    gamma: float = 1.0
    black: float = 0.0
    white: float = 255.0


def curve_of(sensor: SensorSettings) -> Curve:
    """Return the curve that settings describe."""
    return Curve(sensor.response, sensor.gamma, sensor.black_grey, sensor.white_grey)


ONE = np.float32(1)
ENCODING_BINS = 4096
"""Finer than the closest grey levels in linear light: each bin has at most one edge."""
QUANTILES = 1 << 16
"""Size of the table of normal quantiles: a look-up takes an eighth of the time of a new draw."""


def _srgb_to_linear(srgb: Array) -> Array:
    """IEC 61966-2-1, both 0 to 1."""
    bright = ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4
    return np.where(srgb <= 0.04045, srgb / 12.92, bright)


LINEAR: Array = _srgb_to_linear(np.arange(256) / 255).astype(np.float32)
"""(256,) float32 linear light, 0 to 1, of each level of a rendered (sRGB) image."""


def decode(image: Image) -> Array:
    """Return the linear light, float32 of 0 to 1, of a rendered (H, W[, 3]) uint8 image."""
    return np.asarray(cv2.LUT(image, LINEAR))


def levels_to_light(curve: Response | Curve, levels: Array) -> Array:
    """Convert (fractional) grey levels of a sensor, any shape, to linear light.

    It is negative below the level of no light, and over 1 beyond that of full light.
    """
    response, gamma, black, white = curve if isinstance(curve, Curve) else Curve(curve)
    share = (np.asarray(levels, np.float64) - black) / (white - black)
    share = np.sign(share) * abs(share) ** (1 / gamma)
    return _srgb_to_linear(share) if response == "srgb" else share


def light_to_levels(curve: Response | Curve, light: Array) -> Array:
    """Convert linear light, any shape, to fractional grey levels 0 to 255."""
    response, gamma, black, white = curve if isinstance(curve, Curve) else Curve(curve)
    share = np.clip(light, float(levels_to_light(curve, np.array(0.0))), 1)
    if response == "srgb":
        bright = 1.055 * np.maximum(share, 0) ** (1 / 2.4) - 0.055
        share = np.where(share <= 0.0031308, 12.92 * share, bright)
    return black + (white - black) * np.sign(share) * abs(share) ** gamma


class Encoding:
    """Conversion of linear light to the nearest grey level, by a table and one comparison."""

    def __init__(self, curve: Response | Curve) -> None:
        self._curve = curve
        edges = levels_to_light(curve, np.arange(255) + 0.5)
        self._edges = np.append(edges, np.inf).astype(np.float32)
        starts = np.arange(ENCODING_BINS + 1) / np.float32(ENCODING_BINS)
        first = np.searchsorted(self._edges, starts, side="right")
        self._first = first.astype(np.uint8)
        is_fine = edges[0] >= 0 and np.diff(first).max() <= 1
        self._bins = (self._edges[first], first.astype(np.int32)) if is_fine else None

    def __call__(self, light: Array) -> Image:
        """Encode (H, W[, 3]) float32 light; values outside [0, 1] are clipped."""
        out = np.empty(light.shape, np.uint8)
        _encode(light.ravel(), self._edges, self._first, out.reshape(-1))
        return out

    def encode_noisy(
        self,
        light: Array,
        shot: float,
        floor: float,
        rng: np.random.Generator,
        share: Array | np.float32 = ONE,
    ) -> Image:
        """Encode a share (H, W) of (H, W[, 3]) light, float32, with normal noise added.

        Its variance is shot * light + floor.
        """
        words = rng.bit_generator.random_raw(-(-light.size // 4))
        drawn = words.astype("<u8", copy=False).view(np.uint16)[: light.size]
        variance, shares = (np.float32(shot), np.float32(floor)), of_each_value(share, light.shape)
        out = np.empty(light.shape, np.uint8)
        if self._bins:
            table = normal_quantiles()
            _encode_noisy(
                light.ravel(), shares, *variance, drawn, table, *self._bins, out.reshape(-1)
            )
            return out
        y = np.maximum(light.ravel() * shares, 0)
        y += np.sqrt(variance[0] * y + variance[1]) * normal_quantiles()[drawn]
        return self(y.reshape(light.shape))

    def encode_deep(
        self, light: Array, bits: int, noise: tuple[float, float, np.random.Generator] | None
    ) -> Array:
        """Encode (H, W[, 3]) light as uint16 levels up to 2^bits - 1; noise as `encode_noisy`."""
        light = np.maximum(light, 0)
        if noise:
            shot, floor, rng = noise
            drawn = normal_quantiles()[rng.integers(0, QUANTILES, light.shape, dtype=np.uint16)]
            light = light + np.sqrt(shot * light + floor) * drawn
        levels = light_to_levels(self._curve, light) * ((2**bits - 1) / 255)
        return np.rint(levels).astype(np.uint16)


def of_each_value(share: Array | np.float32, shape: tuple[int, ...]) -> Array:
    """Repeat a share, (H, W) or one for all, for each value of an (H, W[, C]) image, (N,)."""
    by_pixel = share.reshape(*share.shape, *(1,) * (len(shape) - share.ndim))
    return np.broadcast_to(by_pixel, shape).ravel()


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
    """Return the nearest grey level: the bin's first, or the next beyond an edge."""
    light = min(light, np.float32(1))
    level = int(first[int(max(light, np.float32(0)) * np.float32(ENCODING_BINS))])
    while light >= edges[level]:
        level += 1
    while level > 0 and light < edges[level - 1]:
        level -= 1
    return level


@compiled(nogil=True)
def _encode(light: Array, edges: Array, first: Array, out: Image) -> None:
    for i in range(len(light)):
        out[i] = _level(light[i], edges, first)


@compiled(distinct=True, nogil=True)
def _encode_noisy(
    light: Array,
    share: Array,
    shot: np.float32,
    floor: np.float32,
    drawn: Array,
    quantiles: Array,
    edge: Array,
    first: Array,
    out: Image,
) -> None:
    """Encode as `_level`, by the only edge in each bin: without branches, by vectors."""
    for i in range(len(light)):
        y = max(light[i] * share[i], np.float32(0))
        y += np.sqrt(shot * y + floor) * quantiles[drawn[i]]
        y = min(max(y, np.float32(0)), np.float32(1))
        k = np.int32(y * np.float32(ENCODING_BINS))
        out[i] = np.uint8(first[k] + np.int32(y >= edge[k]))
