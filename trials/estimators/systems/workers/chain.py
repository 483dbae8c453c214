"""Poses from motions between successive frames; requires only NumPy."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pipe import Image, Pose, Track

Align = Callable[[Any, Any], Pose | None]
"""Maps two prepared frames to the 4x4 motion from the first camera to the second, or None."""


def chained(prepare: Callable[[Image, Image], Any], align: Align) -> Track:
    """Return a tracker that aligns each frame with the previous one.

    After a frame that cannot be aligned, which is lost, the next one continues from the last pose.
    """
    before: list[Any] = []
    T_odom_cam = np.eye(4)

    def track(t: float, left: Image, depth: Image) -> tuple[Pose | None, str]:
        nonlocal T_odom_cam
        now = prepare(left, depth)
        last = before.pop() if before else None
        if last is not None:
            T_now_last = align(last, now)
            if T_now_last is None or not np.isfinite(T_now_last).all():
                return None, "no alignment"
            T_odom_cam = T_odom_cam @ _inverse(T_now_last)
        before.append(now)
        return T_odom_cam, ""

    return track


def _inverse(T: Pose) -> Pose:
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse
