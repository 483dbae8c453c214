"""Colours of labels: depth, directions, objects, classes and visibility."""

import colorsys
import math
from dataclasses import dataclass

import cv2
import numpy as np

from scenes.scene import Kind
from sim.labels.visibility import Occlusion
from vo.contract.arrays import Array, Image

RGB = tuple[int, int, int]

NOTHING: RGB = (38, 40, 44)
KINDS: dict[Kind, RGB] = {
    Kind.GROUND: (176, 152, 116),
    Kind.STATIC: (84, 122, 166),
    Kind.MOVING: (228, 82, 60),
    Kind.SKY: (200, 222, 236),
}
INVISIBLE: dict[Occlusion, RGB] = {
    Occlusion.HIDDEN: (255, 112, 26),
    Occlusion.OUTSIDE: (54, 140, 255),
    Occlusion.NOTHING: NOTHING,
}
GOLDEN = 0.618033988749895
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


def object_colours(objects: Array) -> tuple[Image, list[int]]:
    """Colour objects (H, W), with the largest contrast for the largest; 0 is the sky.

    Returns:
        (H, W, 3) RGB, and the numbers that occur, largest area first, without the sky.
    """
    numbers, where, areas = np.unique(objects, return_inverse=True, return_counts=True)
    order = [int(k) for k in np.argsort(-areas) if numbers[k] != 0]
    table = np.zeros((len(numbers), 3), np.uint8)
    table[numbers == 0] = KINDS[Kind.SKY]
    for rank, k in enumerate(order):
        tone = (0.62, 0.92), (0.85, 0.68), (0.38, 0.98), (0.95, 0.9)
        rgb = colorsys.hsv_to_rgb((0.58 + GOLDEN * rank) % 1, *tone[rank % len(tone)])
        table[k] = [round(255 * c) for c in rgb]
    return table[where.reshape(objects.shape)], [int(numbers[k]) for k in order]


def class_colours(classes: Array) -> Image:
    """Colour (H, W) classes as (H, W, 3) RGB."""
    return np.array([KINDS[kind] for kind in Kind], np.uint8)[classes]


def normal_colours(normals: Array) -> Image:
    """Colour (H, W, 3) normals in camera axes: red right, green up, blue towards the camera."""
    channels = normals * np.array([1, -1, -1], np.float32)
    rgb = np.nan_to_num(255 * (channels + 1) / 2, nan=0).astype(np.uint8)
    rgb[np.isnan(normals[..., 0])] = NOTHING
    return rgb


def visibility_colours(codes: Array, view: Image) -> Image:
    """Mark pixels that are not visible in another view on a pale copy of the (H, W, 3) RGB view."""
    grey = np.asarray(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), np.float32)
    rgb = rgb_of((96 + 0.55 * grey).clip(0, 255).astype(np.uint8))
    for code, colour in INVISIBLE.items():
        rgb[codes == code] = colour
    return rgb


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


def flow_wheel(side_px: int) -> Array:
    """Draw the legend of `flow_colours`, (S, S, 4) RGBA, transparent outside the disc."""
    line = np.linspace(-1, 1, side_px)
    du, dv = np.meshgrid(line, line)
    rgb = flow_colours(np.stack([du, dv], axis=-1), 1.0)
    inside = 255 * (np.hypot(du, dv) <= 1)
    return np.dstack([rgb, inside.astype(np.uint8)])


def rgb_of(image: Image) -> Image:
    """Return an (H, W) grey or (H, W, 3) RGB image as RGB."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
