"""Motion by wheel encoders, whose scale and place are learnt from the images.

The step of the camera is a linear function of the two counts since the frame before, whatever the
radius of the wheels, their distance, and where the camera stands; what is left varies as learnt.
So a wrong scale does no harm. Counts that contradict the images (slip, a sensor that died)
are not learnt from, and not used until they agree again.

Source: recursive least squares with exponential forgetting (Haykin, Adaptive Filter Theory, ch. 9).
"""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.compilation import compiled
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

FLOOR = 1e-4
"""Standard deviations of a step, m and rad, that are always left: suspension and counts."""

FLOOR_SHARE = 0.005
"""Standard deviation of a step over its length and over its angle that is always left."""

MIN_DEAD = 5
"""Successive steps of significant motion without a count, of a sensor that is dead."""

SEEN = 100.0
"""Chi-squared of a significant step."""


def predict_wheels(
    wheels: WheelMotion, ticks: tuple[int, int] | None, steps: float
) -> tuple[Array, Array] | None:
    """Predict the motion (4, 4) since the last pose, over a number of steps, and its covariance.

    None without encoders, or where they are not used, or have not yet done the like.
    """
    if ticks is None or wheels.ticks is None or wheels.weight < MIN_STEPS or explain_wheels(wheels):
        return None
    counts = np.subtract(ticks, wheels.ticks).astype(np.float64)
    leverage, tangent, covariance = _predict(
        wheels.counts2, wheels.products, wheels.spread / wheels.weight, counts, steps
    )
    return (se3.exp(tangent), covariance) if leverage <= MAX_LEVERAGE else None


def explain_wheels(wheels: WheelMotion) -> str:
    """Say why encoders are not used; empty if they are."""
    if wheels.silent >= MIN_DEAD:
        return "wheel encoders stand still while the images move: not used"
    return "wheel encoders contradict the images: not used" if wheels.strikes >= MIN_STRIKES else ""


@compiled()
def _predict(
    counts2: Array, products: Array, spread: Array, counts: Array, steps: float
) -> tuple[float, Array, Array]:
    """Predict the tangent (6,) of a motion and its covariance; before them the leverage of counts.

    It is that in the direction in which less was learnt.
    """
    sizes, axes = np.linalg.eigh(counts2 + np.eye(2))
    along = np.array([counts @ axes[:, 0].copy(), counts @ axes[:, 1].copy()])
    parts = along**2 / sizes / steps**2
    tangent = (axes @ (along / sizes)) @ products
    covariance = spread * (steps + parts.sum() * steps**2)
    for i in range(6):
        part = tangent[:3] if i < 3 else tangent[3:]
        covariance[i, i] += steps * FLOOR**2 + FLOOR_SHARE**2 * (part**2).sum()
    return parts[0], tangent, covariance


@compiled()
def _learn(
    counts2: Array, products: Array, spread: Array, weight: float, counts: Array, step: Array,
    covariance: Array,
) -> float:  # fmt: skip
    """Add a step (6,) in place; return its chi-squared, zero if nothing is predicted.

    Where it is a contradiction, nothing is added.
    """
    chi2 = 0.0
    if weight >= MIN_STEPS:
        leverage, tangent, predicted = _predict(counts2, products, spread / weight, counts, 1.0)
        if leverage <= MAX_LEVERAGE:
            apart = step - tangent
            chi2 = float(apart @ np.linalg.solve(predicted + covariance, apart))
    if chi2 > CONTRADICTION:
        return chi2
    counts2[:] = MEMORY * counts2 + np.outer(counts, counts)
    products[:] = MEMORY * products + np.outer(counts, step)
    left = step - np.linalg.solve(counts2 + np.eye(2), counts) @ products
    spread[:] = MEMORY * spread + np.outer(left, left)
    return chi2


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
        moved = (
            step.any() and step @ np.linalg.solve(covariance + FLOOR**2 * np.eye(6), step) > SEEN
        )
        waits = 0 if wheels.silent < MIN_DEAD else wheels.silent
        return replace(wheels, silent=wheels.silent + 1 if moved else waits)
    counts = np.array([ticks[0] - before[0], ticks[1] - before[1]], dtype=np.float64)
    counts2, products, spread = (x.copy() for x in (wheels.counts2, wheels.products, wheels.spread))
    covariance = np.ascontiguousarray(covariance)
    chi2 = _learn(counts2, products, spread, wheels.weight, counts, step, covariance)
    if chi2 <= CONTRADICTION:
        return WheelMotion(ticks, counts2, products, spread, MEMORY * wheels.weight + 1.0)
    if wheels.strikes + 1 >= RELEARN:
        return WheelMotion(ticks)
    return replace(wheels, strikes=wheels.strikes + 1, silent=0)
