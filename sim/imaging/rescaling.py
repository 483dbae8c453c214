"""Grey levels that a share of the light would have had without the loss, by a table of shares."""

from functools import lru_cache

import numpy as np

from sim.imaging.linear_light import Curve, Response, levels_to_light, of_each_value
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

STEP, STEPS_LOW, STEPS_HIGH = np.float32(1 / 128), -1024, 768
"""Spacing of the table's shares, in their natural logarithm, and its first and last one: 1 / 2981
and 403 times the light. Values between are within 0.001 grey levels."""


def log_of_share(share: Array) -> Array:
    """Return the natural logarithm of a share of light, (H, W) float32, at least of the first.

    An unknown share, NaN, counts as 1.
    """
    known = np.nan_to_num(share, nan=1.0)
    return np.log(np.maximum(known, np.exp(STEP * STEPS_LOW)), dtype=np.float32)


def rescale(
    curve: Response | Curve, image: Image, log_share: Array, scale: float = 1.0
) -> tuple[Array, Array]:
    """Divide the light of an image (H, W[, 3]) by the share of a `log_of_share` times a scale.

    Returns:
        Fractional grey levels up to 255, and the factor on small differences of levels, in the
        shape of the image, float32. Between grey levels, light is taken as linear.
    """
    levels, factor = np.empty((2, *image.shape), np.float32)
    offset = np.float32(np.log(scale) / STEP - STEPS_LOW)
    flat = (x.reshape(-1) for x in (image, levels, factor))
    _look_up(of_each_value(log_share, image.shape), offset, *_tables(curve), *flat)
    return levels, factor


@lru_cache(maxsize=4)
def _tables(curve: Response | Curve) -> tuple[Array, Array]:
    """Return grey levels and factors (shares * 256,), float32, of each share and grey level."""
    share = np.exp(np.arange(STEPS_LOW, STEPS_HIGH + 1) * float(STEP))[:, None]
    light = levels_to_light(curve, np.arange(256))
    slope, wanted = np.gradient(light), np.minimum(light / share, 1)
    low = np.clip(np.searchsorted(light, wanted, side="right") - 1, 0, 254)
    rest = (wanted - light[low]) / (light[low + 1] - light[low])
    factor = slope / (share * (slope[low] + rest * (slope[low + 1] - slope[low])))
    return (low + rest).astype(np.float32).ravel(), factor.astype(np.float32).ravel()


@compiled(distinct=True, nogil=True)
def _look_up(
    log_share: Array,
    offset: np.float32,
    levels: Array,
    factors: Array,
    image: Image,
    out: Array,
    factor: Array,
) -> None:
    last = np.float32(len(levels) // 256 - 2)
    for i in range(len(image)):
        place = min(max(log_share[i] * np.float32(1 / STEP) + offset, np.float32(0)), last)
        row = np.int32(place)
        rest, k = place - np.float32(row), np.int32(row * np.int32(256) + np.int32(image[i]))
        out[i] = levels[k] + rest * (levels[k + np.int32(256)] - levels[k])
        factor[i] = factors[k]
