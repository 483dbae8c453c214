"""Motion by wheel encoders, whatever the radius, distance and place of the wheels.

`vo.tracking.learnt_motion` says how it is learnt.
"""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.map.state import LearntMotion, TrackerState
from vo.tracking.learnt_motion import is_contradictory, is_dead, learn, note_silence, predict

Ticks = tuple[int, int]


def predict_wheels(
    wheels: LearntMotion, ticks: Ticks | None, steps: float
) -> tuple[Array, Array] | None:
    """Predict the motion (4, 4) since the last pose, over a number of steps, and its covariance.

    None without encoders, or where they are not used, or have not yet done the like.
    """
    if ticks is None or wheels.readings is None:
        return None
    counts = np.subtract(ticks, wheels.readings).astype(np.float64)
    predicted = predict(wheels, counts, steps)
    return None if predicted is None else (se3.exp(predicted[0]), predicted[1])


def explain_wheels(wheels: LearntMotion) -> str:
    """Say why encoders are not used; empty if they are."""
    if is_dead(wheels):
        return "wheel encoders stand still while the images move: not used"
    return "wheel encoders contradict the images: not used" if is_contradictory(wheels) else ""


def read_wheels(state: TrackerState, frame: StereoFrame, settings: OdometrySettings) -> StereoFrame:
    """Keep the counts of a frame, and take them from it if its encoders would say that they stand.

    That is so where they have died: they would hold the pose. Only `stationary` encoders uses them.
    """
    state.ticks = frame.wheel_ticks if settings.stationary == "encoders" else None
    stand_still = is_dead(state.wheels) and state.ticks == state.wheels.readings
    return replace(frame, wheel_ticks=None) if stand_still else frame


def learn_wheels(
    wheels: LearntMotion, ticks: Ticks | None, T_last_cam: Array | None, covariance: Array
) -> LearntMotion:
    """Learn from the step (4, 4) by images between successive frames, and its covariance (6, 6).

    Without a step only the counts at the pose are kept.
    """
    before = wheels.readings
    wheels = replace(wheels, readings=ticks)
    if ticks is None or before is None or T_last_cam is None:
        return wheels
    step = se3.log_small(T_last_cam)
    if ticks == before:
        return note_silence(wheels, step, covariance)
    return learn(wheels, np.subtract(ticks, before).astype(np.float64), step, covariance)
