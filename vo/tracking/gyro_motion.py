"""Rotation by a gyroscope, whatever its axes, its scale and its bias.

`vo.tracking.learnt_motion` says how it is learnt. The bias turns with time, so that time is one of
the numbers of a step.
"""

from dataclasses import replace

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.map.state import LearntMotion
from vo.tracking.learnt_motion import is_contradictory, is_dead, learn, note_silence, predict

UNIT_RAD = 1e-3
"""Unit of the angles: about the noise of a step's rotation, below which nothing is learnt."""

Angles = tuple[float, float, float]


def predict_gyro(
    gyro: LearntMotion, angles_rad: Angles | None, steps: float
) -> tuple[Array, Array] | None:
    """Predict the rotation vector (3,) since the last pose, rad, and its covariance (3, 3).

    None without a gyroscope, or where it is not used, or has not yet turned about the like axes.
    """
    if angles_rad is None or gyro.readings is None:
        return None
    return predict(gyro, _numbers(gyro.readings, angles_rad, steps), steps)


def explain_gyro(gyro: LearntMotion) -> str:
    """Say why the gyroscope is not used; empty if it is."""
    if is_dead(gyro):
        return "gyroscope stands still while the images turn: not used"
    return "gyroscope contradicts the images: not used" if is_contradictory(gyro) else ""


def learn_gyro(
    gyro: LearntMotion, angles_rad: Angles | None, T_last_cam: Array | None, covariance: Array
) -> LearntMotion:
    """Learn from the step (4, 4) by images between successive frames, and its covariance (6, 6).

    Without a step only the angles at the pose are kept.
    """
    before = gyro.readings
    gyro = replace(gyro, readings=angles_rad)
    if angles_rad is None or before is None or T_last_cam is None:
        return gyro
    turn = se3.log_small(T_last_cam)[3:]
    if angles_rad == before:
        return note_silence(gyro, turn, covariance[3:, 3:])
    return learn(gyro, _numbers(before, angles_rad, 1.0), turn, covariance[3:, 3:])


def _numbers(before: tuple[float, ...], angles_rad: Angles, steps: float) -> Array:
    """Angles of a motion in their unit, and its duration (4,)."""
    return np.append(np.subtract(angles_rad, before) / UNIT_RAD, steps)
