"""Colours of depth and flow, and round numbers for their scales."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from vo.contract.arrays import Array, Image

RGB = tuple[int, int, int]

INK, FAINT, PAPER = "#2b3036", "#6d747c", "#f5f4f0"
"""Colours of text, lesser text and background."""
NOTHING: RGB = (38, 40, 44)
ROUND = np.array([digit * 10.0**power for power in range(-6, 7) for digit in (1, 2, 5)])
"""Round numbers, for the ends and marks of scales."""


@dataclass(frozen=True)
class DepthScale:
    """Logarithmic colours of depth, from warm at near_m to cold at far_m."""

    near_m: float
    far_m: float

    def colours(self, depth_m: Array) -> Image:
        """Colour (H, W) depth in metres as (H, W, 3) RGB; NaN is dark."""
        span = math.log(self.far_m / self.near_m)
        share = np.log(np.clip(depth_m, self.near_m, self.far_m) / self.near_m) / span
        levels = np.nan_to_num(255 * (0.96 - 0.92 * share), nan=0).astype(np.uint8)
        rgb = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_TURBO), np.uint8)[..., ::-1].copy()
        rgb[np.isnan(depth_m)] = NOTHING
        return rgb

    def marks(self, max_count: int) -> Array:
        """Return up to `max_count` round depths across the scale."""
        inside = ROUND[(self.near_m * 0.999 <= ROUND) & (self.far_m * 1.001 >= ROUND)]
        count = min(max_count, len(inside))
        return inside[np.unique(np.linspace(0, len(inside) - 1, count).round().astype(int))]


def depth_scale(depth_m: Array) -> DepthScale:
    """Choose round limits around nearly all of an (H, W) depth image."""
    known = depth_m[np.isfinite(depth_m)]
    if known.size == 0:
        return DepthScale(0.5, 10.0)
    near, far = np.percentile(known, (0.5, 98))
    return DepthScale(round_down(float(near)), max(round_up(float(far)), 2 * round_up(float(near))))


def round_down(x: float) -> float:
    """Return the largest of ROUND that is not above x."""
    return float(ROUND[x * (1 + 1e-9) >= ROUND][-1])


def round_up(x: float) -> float:
    """Return the smallest of ROUND that is not below x."""
    return float(ROUND[x * (1 - 1e-9) <= ROUND][0])


def flow_colours(flow: Array, full_px: float) -> Image:
    """Colour (H, W, 2 or more) flow: hue by direction, white at rest, saturated at `full_px`."""
    du, dv = flow[..., 0], flow[..., 1]
    share = np.clip(np.hypot(du, dv) / full_px, 0, 1)
    turn = np.mod(np.degrees(np.arctan2(dv, du)), 360) / 2
    hsv = np.stack([turn, 255 * share, np.full_like(share, 250)], axis=-1)
    hsv = np.nan_to_num(hsv, nan=0).astype(np.uint8)
    rgb = np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.uint8)
    rgb[np.isnan(share)] = NOTHING
    return rgb


def rgb_of(image: Image) -> Image:
    """Return an (H, W) grey or (H, W, 3) RGB image as RGB."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
