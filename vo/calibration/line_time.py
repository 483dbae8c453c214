"""Line time of a rolling shutter, from how rows disagree while the motion changes.

Landmarks that one frame sees in stereo, and another one somewhat later, give the motion between
both. A shutter that exposes rows one after the other moves them by the velocity at each frame and
by their row, as no motion of a rigid scene does.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, find_sorted
from vo.contract.observations import Observations
from vo.contract.projection import stereo_jacobian
from vo.contract.rig import StereoRig
from vo.stereo.rolling_shutter import shift_to_instant

MIN_PAIRS, MIN_POINTS = 20, 20
"""Pairs of frames, and landmarks in both of one, that an estimate needs."""

STEPS, ITERATIONS, HUBER = 2, 5, 1.5
"""Linearizations, reweightings of a pair, and the residual, in sigmas, where a loss is linear."""

STEP_S, MIN_SIGMA_PX = 1e-6, 0.02
"""Step of the derivative by the line time, and smallest standard deviation of a residual."""

MAD_TO_SIGMA = 1.4826
"""From the median absolute value of normal errors to their standard deviation."""


class LineTime(NamedTuple):
    """Time from a row's exposure to that of the next one below, s, with its standard error."""

    value: float
    standard_error: float


class SeenFrame(NamedTuple):
    """A frame's pose (4, 4), its velocity (6,) in its own axes, and inliers with disparities."""

    T_odom_cam: Array
    velocity: Array
    seen: Observations


def estimate_line_time(
    pairs: Sequence[tuple[SeenFrame, SeenFrame]], rig: StereoRig
) -> LineTime | None:
    """Estimate the line time from pairs of frames; None from too few.

    The poses are those by the stated line time. The scatter of pairs gives the standard error.
    """
    value, error = rig.line_time_s, 0.0
    for _ in range(STEPS):
        at = replace(rig, line_time_s=value)
        sums = [x for a, b in pairs if (x := _score(a, b, at)) is not None]
        if len(sums) < MIN_PAIRS:
            return None
        gradient, information = np.array(sums).T
        change = gradient.sum() / information.sum()
        scores = gradient - information * change
        error = float(np.sqrt(np.sum(scores**2)) / information.sum())
        value += float(change)
    return LineTime(value, error)


def _score(before: SeenFrame, now: SeenFrame, rig: StereoRig) -> tuple[float, float] | None:
    """Gradient and information on the line time of a pair, whose motion is free."""
    place = find_sorted(before.seen.ids, now.seen.ids)
    then, here = before.seen.select(place[place >= 0]), now.seen.select(place >= 0)
    if len(here) < MIN_POINTS:
        return None
    T_now_before = se3.inverse(now.T_odom_cam) @ before.T_odom_cam
    start, end = then.measured, here.measured

    def residual(line_time_s: float) -> tuple[Array, Array]:
        at = replace(rig, line_time_s=line_time_s)
        first = start + shift_to_instant(start, at, before.velocity)
        points = se3.transform(T_now_before, rig.triangulate(first[:, :2], first[:, 2]))
        return end + shift_to_instant(end, at, now.velocity) - rig.project(points), points

    left, points = residual(rig.line_time_s)
    slope = (residual(rig.line_time_s + STEP_S)[0] - left) / STEP_S
    J = np.concatenate([stereo_jacobian(points, rig), -slope[:, :, None]], axis=2)
    if not np.isfinite(J).all():
        return None
    rest, information, gradient = left, np.eye(7), np.zeros(7)
    for _ in range(ITERATIONS):
        sigma = np.maximum(MAD_TO_SIGMA * np.median(np.abs(rest), axis=0), MIN_SIGMA_PX)
        weight = np.minimum(1, HUBER / np.maximum(np.abs(rest) / sigma, 1e-9)) / sigma**2
        information = np.einsum("nki,nk,nkj->ij", J, weight, J)
        gradient = np.einsum("nki,nk,nk->i", J, weight, left)
        motion = np.linalg.lstsq(information[:6, :6], gradient[:6])[0]
        rest = left - J[:, :, :6] @ motion
    of_motion = np.linalg.lstsq(information[:6, :6], information[:6, 6])[0]
    own = float(information[6, 6] - information[6, :6] @ of_motion)
    return float(gradient[6] - gradient[:6] @ of_motion), own
