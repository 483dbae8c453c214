"""Motion by wheel encoders, whose scale and place are learnt from the images.

The step of the camera is a linear function of the two counts since the frame before, whatever the
radius of the wheels, their distance, and where the camera stands; what is left varies as learnt.
So a wrong scale cannot be believed. Counts that contradict the images (slip, a sensor that died)
are not learnt from, and not used until they agree again.

Source: recursive least squares with exponential forgetting (Haykin, Adaptive Filter Theory, ch. 9).
"""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.map.state import TrackerState, WheelMotion

MEMORY = 0.98
"""Weight of a step in the next one's: fifty steps count."""

MIN_STEPS = 8.0
"""Weight of steps in motion below which encoders predict nothing."""

MAX_LEVERAGE = 0.5
"""Variance by what was learnt, over that of a step, above which counts are like none seen yet: in
the direction in which there was less, such as the turns of a straight drive."""

CONTRADICTION = 60.0
"""Chi-squared with six degrees of freedom beyond which encoders contradict the images: five sigma,
and half as much again for a covariance that is learnt."""

MIN_STRIKES = 5
"""Successive contradictions that are more than a bump, which jolts the camera a few times."""

RELEARN = 30
"""Successive contradictions after which what was learnt is dropped: the scale has changed."""

FLOOR = np.full(6, 1e-4)
"""Standard deviations of a step, m and rad, that are always left: suspension and counts."""

FLOOR_COVARIANCE = np.diag(FLOOR**2)

FLOOR_SHARE = 0.005
"""Standard deviation of a step over its length and over its angle that is always left."""

MIN_DEAD = 5
"""Successive steps without a count, which images see beyond doubt, of a sensor that is dead."""

SEEN = 100.0
"""Chi-squared of a step that is beyond doubt."""


def predict_wheels(
    wheels: WheelMotion, ticks: tuple[int, int] | None, steps: float
) -> tuple[Array, Array] | None:
    """Predict the motion (4, 4) since the last pose, over a number of steps, and its covariance.

    None without encoders, or where they are not believed, or have not yet done the like.
    """
    found = None if explain_wheels(wheels) else _predict(wheels, ticks, steps)
    return (se3.exp(found[0]), found[1]) if found else None


def explain_wheels(wheels: WheelMotion) -> str:
    """Say why encoders are not believed; empty if they are."""
    if wheels.silent >= MIN_DEAD:
        return "wheel encoders stand still while the images move: not used"
    return "wheel encoders contradict the images: not used" if wheels.strikes >= MIN_STRIKES else ""


def _predict(
    wheels: WheelMotion, ticks: tuple[int, int] | None, steps: float
) -> tuple[Array, Array] | None:
    """Predict the tangent (6,) of the motion, and its covariance."""
    if ticks is None or wheels.ticks is None or wheels.weight < MIN_STEPS:
        return None
    counts = np.subtract(ticks, wheels.ticks).astype(np.float64)
    sizes, axes = np.linalg.eigh(wheels.counts2 + np.eye(2))
    parts = (counts @ axes) ** 2 / sizes / steps**2
    if parts[0] > MAX_LEVERAGE:
        return None
    tangent = counts @ (axes / sizes) @ axes.T @ wheels.products
    squares = np.repeat([tangent[:3] @ tangent[:3], tangent[3:] @ tangent[3:]], 3)
    floor = steps * FLOOR_COVARIANCE + np.diag(FLOOR_SHARE**2 * squares)
    learnt = wheels.spread / wheels.weight
    return tangent, learnt * (steps + parts.sum() * steps**2) + floor


def read_wheels(state: TrackerState, frame: StereoFrame, settings: OdometrySettings) -> StereoFrame:
    """Keep the counts of a frame, and take them from it if its encoders would say that they stand.

    That is so where they have died: they would hold the pose. Only `stationary` encoders uses them.
    """
    state.ticks = frame.wheel_ticks if settings.stationary == "encoders" else None
    is_dead = state.wheels.silent >= MIN_DEAD and state.ticks == state.wheels.ticks
    return replace(frame, wheel_ticks=None) if is_dead else frame


def learn_wheels(
    wheels: WheelMotion, ticks: tuple[int, int] | None, T_last_cam: Array | None, covariance: Array
) -> WheelMotion:
    """Learn from the step (4, 4) by images between successive frames, and its covariance (6, 6).

    Without a step only the counts at the pose are kept.
    """
    before = wheels.ticks
    wheels = replace(wheels, ticks=ticks)
    if ticks is None or before is None or T_last_cam is None:
        return wheels
    step = se3.log_small(T_last_cam)
    if ticks == before:
        moved = step.any() and step @ np.linalg.solve(covariance + FLOOR_COVARIANCE, step) > SEEN
        waits = 0 if wheels.silent < MIN_DEAD else wheels.silent
        return replace(wheels, silent=wheels.silent + 1 if moved else waits)
    predicted = _predict(replace(wheels, ticks=before), ticks, 1.0)
    if predicted:
        apart = step - predicted[0]
        chi2 = float(apart @ np.linalg.solve(predicted[1] + covariance, apart))
        if chi2 > CONTRADICTION:
            if wheels.strikes + 1 >= RELEARN:
                return WheelMotion(ticks)
            return replace(wheels, strikes=wheels.strikes + 1, silent=0)
    counts = np.subtract(ticks, before).astype(np.float64)
    counts2 = MEMORY * wheels.counts2 + np.outer(counts, counts)
    products = MEMORY * wheels.products + np.outer(counts, step)
    left = step - counts @ np.linalg.inv(counts2 + np.eye(2)) @ products
    spread = MEMORY * wheels.spread + np.outer(left, left)
    return WheelMotion(ticks, counts2, products, spread, MEMORY * wheels.weight + 1.0)
