"""The cameras of a view in motion: rows of a rolling shutter, and a right camera in error."""

from dataclasses import replace

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.map.frame import View
from vo.map.state import TrackerState
from vo.stereo.right_camera import MisalignedFrame, RightCamera


def correct_cameras(state: TrackerState, view: View, T_odom_cam: Array) -> View:
    """Set velocity and right camera of a view whose pose (4, 4) is known roughly, if it matters."""
    if state.stereo_errors is None and not view.rig.line_time_s:
        return view
    velocity = end_velocity(add_step(state, view, T_odom_cam))
    if view.rig.line_time_s:
        view = replace(view, velocity=velocity)
    if state.stereo_errors is None:
        return view
    right = RightCamera(state.stereo_errors, view.rig, velocity)
    return replace(view, frame=MisalignedFrame(**vars(view.frame) | {"right_camera": right}))


def add_step(state: TrackerState, view: View, T_odom_cam: Array) -> tuple[Array, ...]:
    """Velocities of the last steps, with that to the pose (4, 4) of a later view."""
    seconds = (view.frame.timestamp_ns - state.pose_ns) * 1e-9
    if seconds <= 0:
        return state.velocities
    step = se3.log(se3.inverse(state.T_odom_cam) @ T_odom_cam) / seconds
    return (*state.velocities, step)[-2:]


def end_velocity(velocities: tuple[Array, ...]) -> Array:
    """Velocity (6,) at the end of the last two steps, or of one; zero where none is known."""
    if len(velocities) < 2:
        return velocities[0] if velocities else np.zeros(6)
    before, last = velocities
    return 1.5 * last - 0.5 * before
