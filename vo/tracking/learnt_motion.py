"""Motion by another sensor, of which the images teach what its readings stand for.

The step of the camera is a linear function of what the sensor has counted since the frame before,
whatever its scale and its place; what is left varies as learnt. So a wrong scale does no harm.
Readings that contradict the images (slip, a sensor that died) are not learnt from, and not used
until they agree again.

Source: recursive least squares with exponential forgetting (Haykin, Adaptive Filter Theory, ch. 9).
"""

from dataclasses import replace

import numpy as np

from vo.contract.arrays import Array, copy_values
from vo.contract.compilation import compiled
from vo.map.state import LearntMotion, nothing_learnt

MEMORY = 0.98
"""Weight of a step in the next one's: fifty steps count."""

MIN_STEPS = 8.0
"""Weight of steps in motion below which a sensor predicts nothing."""

MAX_LEVERAGE = 0.5
"""Variance by what was learnt, over that of a step, above which readings are like none seen yet: in
the direction in which there was least, such as the turns of a straight drive."""

CONTRADICTION = 60.0
"""Chi-squared with at most six degrees of freedom beyond which a sensor contradicts the images:
five sigma, and half as much again for a covariance that is learnt."""

MIN_STRIKES = 5
"""Successive contradictions that are more than a bump, which jolts the camera a few times."""

RELEARN = 30
"""Successive contradictions after which what was learnt is dropped: the scale has changed."""

FLOOR = 1e-4
"""Standard deviations of a step, m and rad, that are always left: suspension and counts."""

FLOOR_SHARE = 0.005
"""Standard deviation of a step over its length and over its angle that is always left."""

MIN_DEAD = 5
"""Successive steps of significant motion without a reading, of a sensor that is dead."""

SEEN = 100.0
"""Chi-squared of a significant step."""


def predict(learnt: LearntMotion, numbers: Array, steps: float) -> tuple[Array, Array] | None:
    """Predict the tangent (M,) of a motion over a number of steps, and its covariance (M, M).

    None where the sensor is not used, or has not yet done the like of these numbers (N,).
    """
    if learnt.weight < MIN_STEPS or is_dead(learnt) or is_contradictory(learnt):
        return None
    spread = learnt.spread / learnt.weight
    leverage, tangent, covariance = _predict(
        learnt.squares, learnt.products, spread, numbers, steps
    )
    return (tangent, covariance) if leverage <= MAX_LEVERAGE else None


def is_dead(learnt: LearntMotion) -> bool:
    """Whether the images move and the sensor says that nothing does."""
    return learnt.silent >= MIN_DEAD


def is_contradictory(learnt: LearntMotion) -> bool:
    """Whether the sensor contradicts the images."""
    return learnt.strikes >= MIN_STRIKES


def note_silence(learnt: LearntMotion, step: Array, covariance: Array) -> LearntMotion:
    """Count a step (M,) of the images, if it is significant, for which the sensor stood still."""
    spread = covariance + FLOOR**2 * np.eye(len(step))
    if step.any() and step @ np.linalg.solve(spread, step) > SEEN:
        return replace(learnt, silent=learnt.silent + 1)
    return learnt if is_dead(learnt) else replace(learnt, silent=0)


def learn(learnt: LearntMotion, numbers: Array, step: Array, covariance: Array) -> LearntMotion:
    """Learn from a step (M,) of the images, its covariance (M, M) and the sensor's numbers (N,)."""
    squares, products, spread = (x.copy() for x in (learnt.squares, learnt.products, learnt.spread))
    covariance = np.ascontiguousarray(covariance)
    chi2 = _learn(squares, products, spread, learnt.weight, numbers, step, covariance)
    if chi2 <= CONTRADICTION:
        weight = MEMORY * learnt.weight + 1.0
        return LearntMotion(squares, products, spread, weight, learnt.readings)
    if learnt.strikes + 1 >= RELEARN:
        return replace(nothing_learnt(*learnt.products.shape), readings=learnt.readings)
    return replace(learnt, strikes=learnt.strikes + 1, silent=0)


@compiled()
def _predict(
    squares: Array, products: Array, spread: Array, numbers: Array, steps: float
) -> tuple[float, Array, Array]:
    """Predict the tangent (M,) of a motion and its covariance; before them the leverage of numbers.

    It is that in the direction in which least was learnt.
    """
    sizes, axes = np.linalg.eigh(squares + np.eye(len(numbers)))
    along = axes.T @ numbers
    parts = along**2 / sizes / steps**2
    tangent = (axes @ (along / sizes)) @ products
    covariance = spread * (steps + parts.sum() * steps**2)
    for i in range(len(tangent)):
        part = tangent[:3] if i < 3 else tangent[3:]
        covariance[i, i] += steps * FLOOR**2 + FLOOR_SHARE**2 * (part**2).sum()
    return parts[0], tangent, covariance


@compiled()
def _learn(
    squares: Array, products: Array, spread: Array, weight: float, numbers: Array, step: Array,
    covariance: Array,
) -> float:  # fmt: skip
    """Add a step (M,) in place; return its chi-squared, zero if nothing is predicted.

    Where it is a contradiction, nothing is added.
    """
    chi2 = 0.0
    if weight >= MIN_STEPS:
        leverage, tangent, predicted = _predict(squares, products, spread / weight, numbers, 1.0)
        if leverage <= MAX_LEVERAGE:
            apart = step - tangent
            chi2 = float(apart @ np.linalg.solve(predicted + covariance, apart))
    if chi2 > CONTRADICTION:
        return chi2
    copy_values(MEMORY * squares + np.outer(numbers, numbers), squares)
    copy_values(MEMORY * products + np.outer(numbers, step), products)
    fitted = np.linalg.solve(squares + np.eye(len(numbers)), numbers) @ products
    left = step - fitted
    copy_values(MEMORY * spread + np.outer(left, left), spread)
    return chi2
