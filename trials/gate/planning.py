"""Number of sequences that a wanted sensitivity needs."""

import numpy as np

from trials.gate.statistics import MIN_DEGREES, MIN_SCENES, detectable

MAX_SEEDS, MAX_SCENES = 200, 500


def seeds_needed(
    within: float, between: float, scenes: int, change: float, level: float, power: float
) -> int | None:
    """Find the smallest number of seeds of each of these scenes that detects a true log ratio.

    More seeds reduce the variance within scenes, not that between scenes.

    Args:
        within: As of `design_error`.
        between: As of `design_error`.
        scenes: As of `design_error`.
        change: Log ratio to find.
        level: Significance level of the one-sided test.
        power: Probability to find it.

    Returns:
        None if MAX_SEEDS are not enough, or `within` is not known.
    """
    if np.isnan(within):
        return None
    counts = range(1, MAX_SEEDS + 1)
    return next(
        (n for n in counts if _finds(within, between, scenes, n, change, level, power)), None
    )


def scenes_needed(
    within: float, between: float, seeds: int, change: float, level: float, power: float
) -> int | None:
    """Find the smallest number of scenes with `seeds` each; otherwise as `seeds_needed`."""
    counts = range(MIN_SCENES, MAX_SCENES + 1)
    return next(
        (k for k in counts if _finds(within, between, k, seeds, change, level, power)), None
    )


def design_error(within: float, between: float, scenes: int, seeds: int) -> tuple[float, int]:
    """Compute the standard error of the mean of a balanced design, and its degrees of freedom.

    Args:
        within: Standard deviation of sequences about their scene's mean; NaN counts as none.
        between: Standard deviation of scenes beyond that.
        scenes: Number of scenes; below MIN_SCENES they are taken as fixed.
        seeds: Number of seeds of each.
    """
    own = float(np.nan_to_num(within)) ** 2 / seeds
    if scenes >= MIN_SCENES:
        return float(np.sqrt((between**2 + own) / scenes)), scenes - 1
    return float(np.sqrt(own / scenes)), scenes * (seeds - 1)


def _finds(
    within: float,
    between: float,
    scenes: int,
    seeds: int,
    change: float,
    level: float,
    power: float,
) -> bool:
    error, degrees = design_error(within, between, scenes, seeds)
    return degrees >= MIN_DEGREES and detectable(error, degrees, level, power) <= change
