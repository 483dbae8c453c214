"""Offset of a sensor's clock against the camera's, from how both see the motion change."""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices

LARGEST_S, STEP_S = 0.2, 0.005
"""Range and steps of the search."""

MIN_STEPS, MIN_CORRELATION = 20, 0.9
"""Steps of the camera, and likeness of both courses, that an estimate needs."""

SLOPE_S = 0.002
"""Step of the derivative by time."""


class ClockOffset(NamedTuple):
    """What is to be added to the camera's times to get the sensor's, s, with its standard error."""

    value: float
    standard_error: float


def estimate_clock_offset(
    frame_ns: Indices, motion: Array, sensor_ns: Indices, total: Array
) -> ClockOffset | None:
    """Find at which offset the motion of a camera is that of a sensor but for scale and constant.

    The camera moves by `motion` (N - 1,) between frames at times (N,). The sensor's times (M,) have
    the sums (M,) or (M, K) of its readings, of which the size of a difference is a motion. None
    without enough of both, or where the motions are not alike: of another axis, or steady.
    """
    first_s, last_s = ((x - frame_ns[0]) * 1e-9 for x in (frame_ns[:-1], frame_ns[1:]))
    sensor_s = (sensor_ns - frame_ns[0]) * 1e-9
    total = total.reshape(len(total), -1)
    inside = (first_s > sensor_s[0] + LARGEST_S) & (last_s < sensor_s[-1] - LARGEST_S)
    if inside.sum() < MIN_STEPS:
        return None
    seconds = (last_s - first_s)[inside]
    of_camera = motion[inside] / seconds

    def rates(offset_s: float) -> Array:
        ends = [
            np.stack([np.interp(at + offset_s, sensor_s, x) for x in total.T], axis=-1)
            for at in (first_s[inside], last_s[inside])
        ]
        return np.linalg.norm(ends[1] - ends[0], axis=1) / seconds

    def fit(offset_s: float) -> tuple[Array, Array]:
        design = np.column_stack([rates(offset_s), np.ones(len(of_camera))])
        solution = np.linalg.lstsq(design, of_camera, rcond=None)[0]
        return solution, of_camera - design @ solution

    tried = np.arange(-LARGEST_S + SLOPE_S, LARGEST_S, STEP_S)
    offset_s = float(tried[np.argmin([np.sum(fit(x)[1] ** 2) for x in tried])])
    slope, residual = np.zeros(1), of_camera
    for _ in range(3):  # Gauss-Newton
        (scale, _), residual = fit(offset_s)
        slope = scale * (rates(offset_s + SLOPE_S) - rates(offset_s - SLOPE_S)) / (2 * SLOPE_S)
        slope = slope - slope.mean()
        offset_s += float(slope @ residual / max(slope @ slope, 1e-12))
    if np.var(residual) > (1 - MIN_CORRELATION**2) * np.var(of_camera):
        return None
    variance = residual @ residual / max(len(residual) - 3, 1) / max(slope @ slope, 1e-12)
    return ClockOffset(offset_s, float(np.sqrt(variance)))
