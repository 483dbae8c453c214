"""Band-limited noise and the operators that turn it into colour."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.fft

from scenes.surfaces import Shape
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

MAX_EXPONENT = 746.0
"""Exponent x from which exp(-x) is zero in double precision."""


def fractal(
    rng: np.random.Generator,
    shape: Sequence[int],
    wavelengths_px: tuple[float, float],
    slope: float = 1.0,
    stretch: float = 1.0,
) -> Array:
    """Draw periodic noise whose power lies between two wavelengths.

    Args:
        rng: Source of the phases and amplitudes.
        shape: (..., H, W); leading axes are independent draws.
        wavelengths_px: Shortest and longest wavelength kept, in pixels.
        slope: Amplitude falls with spatial frequency as f ** -slope; 1 is natural, 0 is white.
        stretch: Features are this many times longer along the columns (u) than along the rows.

    Returns:
        (..., H, W) float32 of zero mean and unit deviation over each (H, W) cell, which tiles.
    """
    height, width = shape[-2:]
    white = rng.standard_normal(tuple(shape), dtype=np.float32)
    gain = _gain(height, width, wavelengths_px, slope, stretch)
    noise = _filtered(white, gain)
    noise /= np.maximum(noise.std(axis=(-2, -1), keepdims=True), 1e-9)
    return noise


def _filtered(white: Array, gain: Array) -> Array:
    """Multiply the spectra of real (..., H, W) by a gain; W, or fewer, of its columns are not zero.

    The result is that of `rfft2` and `irfft2` bit for bit; those also transform columns of zeros.
    """
    (height, width), rows = white.shape[-2:], len(gain)
    columns = np.flatnonzero(gain.any(axis=0))
    kept = int(columns[-1]) + 1 if len(columns) else 0
    along = np.asarray(scipy.fft.rfft(white))
    spectrum = np.asarray(scipy.fft.fft(along[..., :kept].copy(), axis=-2, overwrite_x=True))
    spectrum[..., :rows, :] *= gain[:, :kept]
    spectrum[..., rows:, :] *= gain[height - rows : 0 : -1, :kept]
    inverse: Mapping[str, Any] = {"norm": "forward", "overwrite_x": True}  # not scaled
    along[..., :kept] = scipy.fft.ifft(spectrum, axis=-2, **inverse)
    along[..., kept:] = 0
    noise = np.asarray(scipy.fft.irfft(along, n=width, **inverse))
    noise *= np.float32(1 / (height * width))
    return noise


@lru_cache(maxsize=64)
def _gain(
    height: int, width: int, wavelengths_px: tuple[float, float], slope: float, stretch: float
) -> Array:
    """Return the gain (float32) of the rows of a real spectrum from 0 on, as of `_frequencies`.

    A scene has some 50 of these, together 30 MB, and draws the same in each of its layouts.
    """
    frequency = _frequencies(height, width, stretch)
    shortest, longest = wavelengths_px
    soft_edge = (frequency * shortest) ** 4  # a hard upper edge would ring
    band = (frequency >= 1 / longest) & (soft_edge < MAX_EXPONENT)
    gain = np.zeros(frequency.shape, np.float32)
    gain[band] = frequency[band] ** -slope * np.exp(-soft_edge[band])
    gain.flags.writeable = False
    return gain


@lru_cache(maxsize=4)
def _frequencies(height: int, width: int, stretch: float) -> Array:
    """Return the spatial frequency, cycles per pixel, of the rows of a real spectrum from 0 on.

    (H // 2 + 1, W // 2 + 1); the other rows are those of the negative frequencies.
    """
    across, along = scipy.fft.rfftfreq(height)[:, None], scipy.fft.rfftfreq(width)[None, :]
    frequency = np.hypot(across, stretch * along)
    frequency.flags.writeable = False
    return frequency


def smoothstep(low: float, high: float, values: Array) -> Array:
    """Rise from 0 at `low` to 1 at `high` with zero slope at both ends; any shape."""
    out = np.asarray((values - low) / (high - low), order="C")
    _smooth(out.reshape(-1))
    return out


def blend(base: Array, over: Array | Sequence[float], weight: Array) -> Array:
    """Mix colours: (..., 3) base with (..., 3) over by (...) weight in [0, 1]."""
    over = np.asarray(over, dtype=np.float32)
    shape = np.broadcast_shapes(base.shape, over.shape, (*weight.shape, 1))
    out = np.empty(shape, np.result_type(base, over, weight))
    share = np.broadcast_to(weight, shape[:-1]).reshape(-1)
    _blend_all(_flat(base, shape), _flat(over, shape), share, out.reshape(-1, shape[-1]))
    return out


def rim(shape: Shape) -> Array:
    """Measure the distance in pixels of each pixel of (H, W) from the nearest border."""
    height, width = shape
    v, u = np.arange(height)[:, None], np.arange(width)
    return np.minimum(np.minimum(u, width - 1 - u), np.minimum(v, height - 1 - v))


def ramp(stops: Sequence[Sequence[float] | Array], values: Array) -> Array:
    """Interpolate K evenly spaced colour stops at (...) values in [0, 1]: (..., 3)."""
    table = np.asarray(stops, dtype=np.float32)
    at = np.clip(values, 0, 1) * (len(table) - 1)
    out = np.empty((*at.shape, table.shape[1]), np.float32)
    _ramp_all(table, np.ravel(at), out.reshape(-1, table.shape[1]))
    return out


def to_image(colour: Array) -> Image:
    """Quantise (..., 3) colours in 0..255 to uint8, clipping."""
    out = np.empty(colour.shape, np.uint8)
    _quantise(np.ravel(colour), np.ravel(out))
    return out


# One pass over the pixels in place of a temporary image for every operation.


def _flat(colour: Array, shape: tuple[int, ...]) -> Array:
    """Broadcast to a shape (..., C) as (N, C), without a copy where there is one colour only."""
    if colour.ndim == 1:
        return np.broadcast_to(colour, (math.prod(shape[:-1]), shape[-1]))
    return np.broadcast_to(colour, shape).reshape(-1, shape[-1])


@compiled()
def _smooth(t: Array) -> None:
    for i in range(len(t)):
        x = min(max(t[i], t.dtype.type(0)), t.dtype.type(1))
        t[i] = x * x * (t.dtype.type(3) - t.dtype.type(2) * x)


@compiled()
def _blend_all(under: Array, over: Array, weight: Array, out: Array) -> None:
    for i in range(len(out)):
        for channel in range(3):  # a constant, so that the loop is unrolled
            below = under[i, channel]
            out[i, channel] = below + (over[i, channel] - below) * weight[i]


@compiled()
def _ramp_all(table: Array, at: Array, out: Array) -> None:
    for i in range(len(at)):
        lower = min(int(at[i]), len(table) - 2)
        share = np.float32(at[i] - lower)
        for channel in range(table.shape[1]):
            below, above = table[lower, channel], table[lower + 1, channel]
            out[i, channel] = below * (np.float32(1) - share) + above * share


@compiled()
def _quantise(colour: Array, out: Image) -> None:
    for i in range(len(colour)):
        value = colour[i] + colour.dtype.type(0.5)
        out[i] = 0 if value < 0 else 255 if value > 255 else np.uint8(value)
