"""Rain: streaks of falling drops in front of what both cameras see, and light that drops take.

A drop near the cameras shows a wide view of its surroundings, as bright as fog, along the way that
it falls during the exposure. It is one drop for both cameras. Farther ones take light as fog does.
The motion of the cameras during the exposure, wind, and blur of what is nearer than NEAR_M are left
out.

Source: sizes of Marshall and Palmer, The distribution of raindrops with size, 1948; speeds of
Atlas, Srivastava and Sekhon, 1973; streaks as in Garg and Nayar, Vision and rain, 2007.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim.imaging.fog import AIRLIGHT, CONTRAST
from sim.imaging.linear_light import decode
from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig

NEAR_M, FAR_M = 0.3, 4.0
"""Depths between which drops are drawn."""
DROPS_PER_M3_MM, SMALLEST_MM, LARGEST_MM = 8000.0, 0.5, 6.0
STEP_PX = 0.5
"""Spacing of the points of a streak, along and across it."""


def rain_visibility_m(rate_mm_h: float) -> float:
    """Return the distance at which rain leaves 5 % of the contrast.

    Each drop takes twice the light that meets it: the extinction is pi N / slope^3 per metre.
    """
    extinction = math.pi * DROPS_PER_M3_MM / _slope(rate_mm_h) ** 3 * 1e-6
    return -math.log(CONTRAST) / extinction


@dataclass(frozen=True)
class Drops:
    """Drops in front of a stereo pair.

    Attributes:
        points_cam: (N, 3) places at mid-exposure, in the left camera's axes.
        sizes_m: (N,) diameters.
        falls_cam: (N, 3) ways during the exposure.
    """

    points_cam: Array
    sizes_m: Array
    falls_cam: Array


def draw_drops(
    rate_mm_h: float, rig: StereoRig, exposure_s: float, down_cam: Array, rng: np.random.Generator
) -> Drops:
    """Draw the drops that streak the images of a rig; down (3,) is a unit vector."""
    slope, f_px = _slope(rate_mm_h), rig.f_px
    pad_px = f_px * 9.65 * exposure_s / 2 / NEAR_M
    width_px = rig.width_px + 2 * pad_px + f_px * rig.baseline_m / NEAR_M
    height_px = rig.height_px + 2 * pad_px
    volume_m3 = width_px * height_px / f_px**2 * (FAR_M**3 - NEAR_M**3) / 3
    density = DROPS_PER_M3_MM / slope * math.exp(-slope * SMALLEST_MM)
    count = rng.poisson(density * volume_m3)
    z = np.cbrt(rng.uniform(NEAR_M**3, FAR_M**3, count))
    u, v = rng.random((2, count)) * [[width_px], [height_px]] - pad_px
    points = np.column_stack([rig.normalized(np.column_stack([u, v])), np.ones(count)]) * z[:, None]
    sizes_mm = np.minimum(SMALLEST_MM + rng.exponential(1 / slope, count), LARGEST_MM)
    speeds = 9.65 - 10.3 * np.exp(-0.6 * sizes_mm)
    return Drops(points, sizes_mm * 1e-3, (speeds * exposure_s)[:, None] * down_cam)


def streaked(light: Array, depth_m: Array, rig: StereoRig, drops: Drops, x_m: float) -> Array:
    """Return the linear light, float32, of an image (H, W[, 3]) with streaks of drops.

    The image is linear light, or uint8 as rendered; its camera is `x_m` right of the left one.
    Drops are hidden by what is nearer, by the planar depth (H, W), NaN for the sky.
    """
    light = decode(light) if light.dtype == np.uint8 else light
    middle = drops.points_cam - [x_m, 0, 0]
    start, end = (rig.project(middle + x * drops.falls_cam)[:, :2] for x in (-0.5, 0.5))
    covered = np.zeros(depth_m.shape, np.float32)
    z = np.ascontiguousarray(middle[:, 2])
    _cover(covered, np.ascontiguousarray(depth_m), start, end, z, rig.f_px * drops.sizes_m / z)
    passed = np.exp(-covered)[(...,) + (None,) * (light.ndim - 2)]
    return light * passed + np.float32(AIRLIGHT) * (1 - passed)


def _slope(rate_mm_h: float) -> float:
    """Slope of the logarithm of the number of drops over their size, per mm."""
    return 4.1 * rate_mm_h**-0.21


@compiled(nogil=True)
def _cover(
    covered: Array, depth_m: Array, start_px: Array, end_px: Array, z_m: Array, size_px: Array
) -> None:
    """Add the mean area of each drop over the exposure to the pixels along its way."""
    height, width = covered.shape
    for i in range(len(z_m)):
        du, dv = end_px[i, 0] - start_px[i, 0], end_px[i, 1] - start_px[i, 1]
        length = np.hypot(du, dv)
        if not length < 1e4:
            continue
        along = max(int(np.ceil((length + size_px[i]) / STEP_PX)), 1)
        across = max(int(np.ceil(size_px[i] / STEP_PX)), 1)
        cos, sin = (du / length, dv / length) if length > 0 else (0.0, 1.0)
        share = np.float32(np.pi / 4 * size_px[i] ** 2 / (along * across))
        for a in range(along):
            s = (a + 0.5) / along * (length + size_px[i]) - size_px[i] / 2
            for b in range(across):
                t = ((b + 0.5) / across - 0.5) * size_px[i]
                u = start_px[i, 0] + s * cos - t * sin
                v = start_px[i, 1] + s * sin + t * cos
                k, row = int(np.floor(u)), int(np.floor(v))
                if k < 0 or row < 0 or k + 1 >= width or row + 1 >= height:
                    continue
                if depth_m[int(v + 0.5), int(u + 0.5)] < z_m[i]:
                    continue
                p, q = np.float32(u - k), np.float32(v - row)
                covered[row, k] += share * (1 - p) * (1 - q)
                covered[row, k + 1] += share * p * (1 - q)
                covered[row + 1, k] += share * (1 - p) * q
                covered[row + 1, k + 1] += share * p * q
