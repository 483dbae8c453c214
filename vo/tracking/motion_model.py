"""Motion of the camera between poses: constant velocity, as far as the last one lasts.

It predicts the next pose, and carries the path across frames without one, with what a vehicle's
accelerations leave uncertain.
"""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.map.state import TrackerState

ACCELERATION = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Standard deviations, m/s² and rad/s²: a small rover's on rough ground."""

MAX_GAP_S = 1.0
"""Longest time for which the last velocity is kept; after that, nothing is known of the motion."""

UNKNOWN_VARIANCE = 1.0
"""Variance, m² and rad², of the pose of a segment that is not connected to the one before."""

REGULAR = 1.5
"""Time since the last pose, in steps, below which the step is the last one again."""


def predict_motion(state: TrackerState, timestamp_ns: int) -> Array:
    """Predict T_last_now (4, 4), the motion since the last pose; of `MAX_GAP_S` at most."""
    gap_s = min((timestamp_ns - state.pose_ns) * 1e-9, MAX_GAP_S)
    steps = gap_s / (state.step_ns * 1e-9) if state.step_ns else 1.0
    if steps < REGULAR:
        return state.T_last_cam
    return se3.exp(steps * se3.log(state.T_last_cam))


def gap_covariance(state: TrackerState, timestamp_ns: int) -> Array:
    """Covariance (6, 6) of a predicted pose after frames without one.

    That of the last pose, and what accelerations change meanwhile.
    """
    gap_s = (timestamp_ns - state.pose_ns) * 1e-9
    if gap_s > MAX_GAP_S or not state.step_ns:
        return UNKNOWN_VARIANCE * np.eye(6)
    T_now_last = se3.inverse(predict_motion(state, timestamp_ns))
    changed = np.diag((0.5 * ACCELERATION * gap_s**2) ** 2)
    return se3.transform_covariance(T_now_last, state.odom_covariance) + changed
