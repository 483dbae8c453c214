"""Motion of the camera between poses: constant velocity, as far as the last one lasts.

It predicts the next pose, and carries the path across frames without one, with what a vehicle's
accelerations leave uncertain; by wheel encoders and a gyroscope instead, where these agree with the
images.
"""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.map.state import TrackerState
from vo.tracking.gyro_motion import predict_gyro
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
    """Predict T_last_now (4, 4), the motion since the last pose."""
    if _steps(state, frame) < REGULAR:
        return state.T_last_cam
    return _bridge(state, frame)[0]


def gap_covariance(state: TrackerState, frame: StereoFrame) -> Array:
    """Covariance (6, 6) of a predicted pose after frames without one.

    That of the last pose, and what sensors have shown to err, or accelerations change meanwhile.
    """
    T_last_now, changed = _bridge(state, frame)
    return se3.transform_covariance(se3.inverse(T_last_now), state.odom_covariance) + changed


def _steps(state: TrackerState, frame: StereoFrame) -> float:
    """Return the time since the last pose over that of the last step."""
    return (frame.timestamp_ns - state.pose_ns) / state.step_ns if state.step_ns else 1.0


def _bridge(state: TrackerState, frame: StereoFrame) -> tuple[Array, Array]:
    """Predict the motion (4, 4) since the last pose, and the covariance (6, 6) of its error.

    By wheels, or else by the last velocity for `MAX_GAP_S` at most; its rotation by a gyroscope.
    """
    gap_s, steps = (frame.timestamp_ns - state.pose_ns) * 1e-9, _steps(state, frame)
    rolled = predict_wheels(state.wheels, state.ticks, steps)
    if rolled is not None:
        T_last_now, changed = rolled
    else:
        lasting = min(1.0, MAX_GAP_S / gap_s) * steps
        T_last_now = se3.exp(lasting * se3.log(state.T_last_cam))
        is_known = gap_s <= MAX_GAP_S and state.step_ns > 0
        drift = (0.5 * ACCELERATION * gap_s**2) ** 2
        changed = np.diag(drift) if is_known else UNKNOWN_VARIANCE * np.eye(6)
    turned = predict_gyro(state.gyro, state.angles_rad, steps)
    if turned is not None:
        R_last_now = se3.exp(np.concatenate([np.zeros(3), turned[0]]))[:3, :3]
        T_last_now = se3.pose(R_last_now, T_last_now[:3, 3])
        changed[3:], changed[:, 3:] = 0.0, 0.0
        changed[3:, 3:] = turned[1]
    return T_last_now, changed
