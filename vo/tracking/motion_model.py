"""Motion of the camera between poses: constant velocity, as far as the last one lasts.

It predicts the next pose, and carries the path across frames without one, with what a vehicle's
accelerations leave uncertain; by wheel encoders instead, where these agree with the images.
"""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.map.state import TrackerState
from vo.tracking.wheel_motion import predict_wheels

ACCELERATION = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Standard deviations, m/s² and rad/s²: a small rover's on rough ground."""

MAX_GAP_S = 1.0
"""Longest time for which the last velocity is kept; after that, nothing is known of the motion."""

UNKNOWN_VARIANCE = 1.0
"""Variance, m² and rad², of the pose of a segment that is not connected to the one before."""

REGULAR = 1.5
"""Time since the last pose, in steps, below which the step is the last one again."""


def predict_motion(state: TrackerState, frame: StereoFrame) -> Array:
    """Predict T_last_now (4, 4), the motion since the last pose; of `MAX_GAP_S` without wheels."""
    gap_s = (frame.timestamp_ns - state.pose_ns) * 1e-9
    steps = gap_s / (state.step_ns * 1e-9) if state.step_ns else 1.0
    if steps < REGULAR:
        return state.T_last_cam
    if rolled := predict_wheels(state.wheels, state.ticks, steps):
        return rolled[0]
    return se3.exp(min(1.0, MAX_GAP_S / gap_s) * steps * se3.log(state.T_last_cam))


def gap_covariance(state: TrackerState, frame: StereoFrame) -> Array:
    """Covariance (6, 6) of a predicted pose after frames without one.

    That of the last pose, and what wheels have shown to err, or accelerations change meanwhile.
    """
    gap_s = (frame.timestamp_ns - state.pose_ns) * 1e-9
    steps = gap_s / (state.step_ns * 1e-9) if state.step_ns else 1.0
    rolled = predict_wheels(state.wheels, state.ticks, steps)
    if rolled is None and (gap_s > MAX_GAP_S or not state.step_ns):
        return UNKNOWN_VARIANCE * np.eye(6)
    T_now_last = se3.inverse(predict_motion(state, frame))
    changed = rolled[1] if rolled else np.diag((0.5 * ACCELERATION * gap_s**2) ** 2)
    return se3.transform_covariance(T_now_last, state.odom_covariance) + changed
