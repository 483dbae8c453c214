"""Observation and action spaces of the environments."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from sim.settings import RecordSettings
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from trials.gym.env.settings import TrialSettings
from trials.gym.world.sensors import ACCEL_MAX_MPS2, GYRO_MAX_RADPS
from trials.gym.world.start_goal_sampling import TrialError
from vo.config import StereoSettings
from vo.contract.arrays import Array

MAX_POSITION_M = 10_000.0
STEREO = StereoSettings(method="block_matching")
"""Settings of the observed disparity."""
ACTION = spaces.Box(-1.0, 1.0, (2,), np.float32)
ROUNDING = 1e-6


def observation_space(trial: TrialSettings, settings: RecordSettings) -> spaces.Space[Any]:
    """Describe the wanted channels: a Dict of them, or the one alone.

    `left`, `right`: (H, W, 1) grey or (H, W, 3) RGB. `disparity`: (H/2, W/2, 1) pixels of the full
    image by block matching, 0 where unknown. `pose`: estimated x, y in metres and yaw in radians
    in the world. `encoders`: ticks left and right since the reset. `imu`: angular velocity, rad/s,
    and specific force, m/s^2, mean of the step. `goal`: metres forward and to the left of the
    estimated pose.
    """
    rig = settings.rig
    height, width = rig.height_px, rig.width_px
    image = spaces.Box(0, 255, (height, width, 3 if rig.color else 1), np.uint8)
    small = height // STEREO.downscale, width // STEREO.downscale, 1
    rates = np.repeat(np.array([GYRO_MAX_RADPS, ACCEL_MAX_MPS2], np.float32), 3)
    pose = np.array([MAX_POSITION_M, MAX_POSITION_M, np.float32(math.pi)], np.float32)
    known: dict[str, spaces.Box] = {
        "left": image,
        "right": image,
        "disparity": spaces.Box(0.0, float(2 * STEREO.max_disparity_px), small, np.float32),
        "pose": spaces.Box(-pose, pose, (3,), np.float32),
        "encoders": spaces.Box(-(2**40), 2**40, (2,), np.int64),
        "imu": spaces.Box(-rates, rates, (6,), np.float32),
        "goal": spaces.Box(-MAX_POSITION_M, MAX_POSITION_M, (2,), np.float32),
    }
    if isinstance(trial.observe, str):
        return known[trial.observe]
    return spaces.Dict({name: known[name] for name in trial.observe})


def wheel_speeds(action: Array, settings: TrialSettings) -> Array:
    """(2,) wanted speeds of the left and the right wheel, rad/s, for an action (2,), each -1 to 1.

    An action is forward speed and turn to the left, as fractions of `speed_max_mps` and
    `turn_max_radps`; or left and right wheel, as fractions of the speed that both together ask
    of the faster wheel.

    Raises:
        TrialError: If the shape is wrong, or a value is out of range or NaN.
    """
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (2,) or not (np.abs(values) <= 1 + ROUNDING).all():
        names = "forward, turn" if settings.action == "twist" else "left, right"
        raise TrialError(f"action {np.asarray(action).tolist()}: expected ({names}), each -1 to 1")
    side_mps = settings.turn_max_radps * TRACK_M / 2
    if settings.action == "wheels":
        return values * (settings.speed_max_mps + side_mps) / WHEEL_RADIUS_M
    forward_mps, turn_mps = values * (settings.speed_max_mps, side_mps)
    return np.array([forward_mps - turn_mps, forward_mps + turn_mps]) / WHEEL_RADIUS_M
