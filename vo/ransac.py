"""Random sample consensus with an adaptive number of trials (thesis 2.7).

Source: Fischler and Bolles, CACM 1981; L = log p_fail / log(1 - p_good^k), thesis eq. 2.28.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vo.config import MotionSettings
from vo.contract.arrays import Array, Indices, Mask

SAMPLE = 3


@dataclass(frozen=True)
class Consensus:
    """The model that most data agree with.

    Attributes:
        T: (4, 4) the model.
        inliers: (N,) data within the threshold of it.
        trials: Samples drawn.
    """

    T: Array
    inliers: Mask
    trials: int


def ransac(
    count: int,
    solve: Callable[[Indices], Array],
    residuals: Callable[[Array], Array],
    settings: MotionSettings,
    rng: np.random.Generator,
) -> Consensus | None:
    """Find the model with the most inliers; among equals, the one that fits them best.

    Args:
        count: Number of data N.
        solve: (B, 3) sample indices to (S, 4, 4) candidate models; S may be 0.
        residuals: (S, 4, 4) models to (S, N) errors in the unit of the threshold; NaN is bad.
        settings: Threshold, confidence and number of trials.
        rng: Draws the samples.

    Returns:
        None if there are fewer than three data or no sample gives a model.
    """
    if count < SAMPLE:
        return None
    best: Consensus | None = None
    best_score = -1.0
    trials, needed = 0, settings.most_trials
    while trials < needed:
        samples = rng.random((settings.batch, count)).argpartition(SAMPLE - 1, axis=1)[:, :SAMPLE]
        trials += settings.batch
        models = solve(samples)
        if len(models) == 0:
            continue
        with np.errstate(invalid="ignore"):
            errors = residuals(models)
            inliers = errors < settings.threshold
        # The fraction below one breaks ties between equal counts.
        misfit = np.where(inliers, errors, settings.threshold).mean(axis=1) / settings.threshold
        score = inliers.sum(axis=1) + 0.999 * (1 - misfit)
        s = int(score.argmax())
        if score[s] > best_score:
            best, best_score = Consensus(models[s], inliers[s], trials), float(score[s])
            needed = min(
                settings.most_trials, trials_needed(inliers[s].mean(), settings.confidence)
            )
    return None if best is None else Consensus(best.T, best.inliers, trials)


def trials_needed(p_good: float, confidence: float) -> int:
    """Samples of three after which one is all good with the given confidence."""
    p_sample = p_good**SAMPLE
    if p_sample >= 1:
        return 1
    if p_sample <= 0:
        return np.iinfo(np.int64).max
    return int(np.ceil(np.log(1 - confidence) / np.log1p(-p_sample)))
