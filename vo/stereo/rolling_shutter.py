"""Rolling shutter: each row is exposed at a time of its own, while the camera moves.

A frame's pose is that at its timestamp, when the middle row is exposed; other rows are earlier or
later by the line time. Pixels and disparity of a point are carried from the instant of their row to
that of the frame, or back, by the camera's velocity, which hardly changes within a frame. Both
cameras of a pair expose equal rows at the same time.

Source: Hedborg, Forssén, Felsberg and Ringaby, Rolling shutter bundle adjustment, CVPR 2012, with a
constant velocity in each frame.
"""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

FAR_PX = 1e-3
"""Disparity of points whose disparity is unknown: they move as those far away."""

STEPS = 2
"""Steps from an expected pixel to the row in which it is seen, which sets its time."""


def row_delay(rig: StereoRig, v: Array) -> Array:
    """Time (N,) at which rows v (N,) are exposed after the middle one, s."""
    return rig.line_time_s * (v - (rig.height_px - 1) / 2)


def shift_to_instant(seen: Array, rig: StereoRig, velocity: Array) -> Array:
    """Shift (N, 3) that carries u, v and disparity (N, 3) from the time of a row to the frame's.

    The disparity may be NaN. The velocity (6,) is the left camera's, tangent (v m/s, w rad/s) in
    its own frame.
    """
    far = np.where(seen[:, 2] > FAR_PX, seen[:, 2], FAR_PX)  # also where it is NaN
    points, delay_s = rig.triangulate(seen[:, :2], far), row_delay(rig, seen[:, 1])[:, None]
    turn = se3.skew(velocity[3:])
    change = points @ turn.T + velocity[:3]  # of the exponential map, two terms
    points = points + delay_s * change + delay_s**2 / 2 * (change @ turn.T)
    return rig.project(points) - np.column_stack([seen[:, :2], far])


def see_by_rows(expected: Array, rig: StereoRig, velocity: Array) -> Array:
    """Return where points that are expected at (N, 3) at the frame's instant are seen, (N, 3)."""
    seen = expected
    for _ in range(STEPS):
        seen = expected - shift_to_instant(seen, rig, velocity)
    return seen
