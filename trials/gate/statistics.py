"""Statistics of paired log ratios: Student's t with scenes as blocks.

Sequences of one scene are correlated. With MIN_SCENES scenes or more, a scene is one sample, the
mean of its sequences, and the result holds for scenes like these. With fewer, every sequence is a
sample about the mean of its scene, and the result holds for these scenes alone, unless scenes as
samples have more degrees of freedom, as with four scenes of one sequence each that remain of five.
The reasons for Student's t are in docs/decisions/0015, those for counted losses in 0026.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from vo.contract.arrays import Array

MIN_SCENES = 5
MIN_DEGREES = 4
"""Smallest degrees of freedom of the design of a baseline."""
MIN_REMAINING_DEGREES = 2
"""Smallest degrees of freedom of the pairs that losses leave."""
RESAMPLES = 2000
MAX_SEEDS, MAX_SCENES = 200, 500
"""Largest design that is considered."""


@dataclass(frozen=True)
class Effect:
    """Mean of N paired differences, all finite, each of a scene, with its standard error."""

    values: Array
    scenes: tuple[str, ...]

    @staticmethod
    def of(values: Array, scenes: Sequence[str]) -> "Effect":
        """Keep the finite ones of (N,) values with N scenes."""
        known = np.isfinite(values)
        kept = tuple(scene for scene, is_known in zip(scenes, known, strict=True) if is_known)
        return Effect(values[known], kept)

    @property
    def by_scene(self) -> bool:
        """Whether a scene is one sample."""
        return scenes_are_samples(self.scenes)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the variance; not positive if it is undefined."""
        return degrees_of_freedom(self.scenes)

    @property
    def scene_means(self) -> Array:
        """(S,) mean by scene."""
        names = np.array(self.scenes)
        return np.array([self.values[names == name].mean() for name in dict.fromkeys(self.scenes)])

    @property
    def mean(self) -> float:
        """Mean with equal weight for every scene; NaN without pairs."""
        return float(self.scene_means.mean()) if len(self.values) else np.nan

    @property
    def error(self) -> float:
        """Standard error of the mean; NaN without degrees of freedom."""
        if self.degrees < 1:
            return np.nan
        counts = np.array(list(Counter(self.scenes).values()))
        if self.by_scene:
            return float(self.scene_means.std(ddof=1) / np.sqrt(len(counts)))
        return self.within * float(np.sqrt(np.sum(1 / counts)) / len(counts))

    @property
    def within(self) -> float:
        """Standard deviation of pairs about the mean of their scene; NaN with one pair a scene."""
        spare = len(self.values) - len(set(self.scenes))
        return float(np.sqrt(np.sum(self.residuals**2) / spare)) if spare else np.nan

    @property
    def between(self) -> float:
        """Standard deviation of scenes beyond what `within` explains, at least 0.

        With one pair a scene, `within` is unknown and counts as 0.
        """
        means = self.scene_means
        if len(means) < 2:
            return 0.0
        own = 0.0 if np.isnan(self.within) else self.within**2 * len(means) / len(self.values)
        return float(np.sqrt(max(means.var(ddof=1) - own, 0.0)))

    @property
    def residuals(self) -> Array:
        """(N,) differences from the mean of the scene."""
        means = dict(zip(dict.fromkeys(self.scenes), self.scene_means, strict=True))
        return self.values - np.array([means[name] for name in self.scenes])

    def with_losses(self, lost: Sequence[str]) -> "Effect":
        """Add newly lost sequences, given their scenes, if too few degrees of freedom remain.

        Each counts as an increase of the size of the largest change.

        Source:
            Lachin, Worst-rank score analysis with informatively missing observations, 1999.
        """
        if self.degrees >= MIN_DEGREES or not len(self.values):
            return self
        largest = np.abs(self.values).max()
        return Effect(np.append(self.values, [largest] * len(lost)), (*self.scenes, *lost))

    def bounds(self, level: float) -> tuple[float, float]:
        """Compute lower and upper confidence bounds, each with error probability `level`."""
        reach = _quantile(1 - level, self.degrees) * self.error
        return self.mean - reach, self.mean + reach

    def bootstrap(self, level: float) -> tuple[float, float]:
        """Compute confidence bounds by the bias-corrected and accelerated (BCa) bootstrap.

        Source:
            Efron, Better bootstrap confidence intervals, JASA 1987.
        """
        samples = self.scene_means if self.by_scene else self.mean + self.residuals
        if np.ptp(samples) < 1e-12:  # BCa divides by the standard deviation
            return self.mean, self.mean
        found = stats.bootstrap(
            (samples,), np.mean, n_resamples=RESAMPLES, confidence_level=1 - 2 * level,
            method="BCa", rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
        return float(found.low), float(found.high)


def scenes_are_samples(scenes: Sequence[str]) -> bool:
    """Whether a scene is one sample, given the scene of each of N pairs."""
    blocks = len(set(scenes))
    return blocks >= MIN_SCENES or blocks - 1 > len(scenes) - blocks


def degrees_of_freedom(scenes: Sequence[str]) -> int:
    """Count the degrees of freedom of pairs in these scenes."""
    blocks = len(set(scenes))
    return blocks - 1 if scenes_are_samples(scenes) else len(scenes) - blocks


def detectable(error: float, degrees: int, level: float, power: float) -> float:
    """Compute the smallest true mean that is found greater than zero with probability `power`.

    Args:
        error: Standard error of the mean.
        degrees: Degrees of freedom, >= 1.
        level: Significance level of the one-sided test.
        power: Wanted probability.

    Source:
        The non-central t distribution: Cohen, Statistical Power Analysis, 1988, chapter 2.
    """
    critical = _quantile(1 - level, degrees)

    def shortfall(noncentrality: float) -> float:
        return float(stats.nct.sf(critical, degrees, noncentrality)) - power

    root: Any = brentq(shortfall, 0.0, critical + 40.0, xtol=1e-14)
    return error * float(root)


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


def seeds_needed(
    within: float, between: float, scenes: int, change: float, level: float, power: float
) -> int | None:
    """Find the smallest number of seeds of each of these scenes that detects a true log ratio.

    More seeds reduce the variance within scenes, not that between scenes. The first three
    arguments are as of `design_error`, the last two as of `detectable`.

    Returns:
        None if MAX_SEEDS are not enough, or `within` is not known.
    """
    designs = {n: design_error(within, between, scenes, n) for n in range(1, MAX_SEEDS + 1)}
    return None if np.isnan(within) else _smallest(designs, change, level, power)


def scenes_needed(
    within: float, between: float, seeds: int, change: float, level: float, power: float
) -> int | None:
    """Find the smallest number of scenes with `seeds` each; otherwise as `seeds_needed`."""
    counts = range(MIN_SCENES, MAX_SCENES + 1)
    designs = {k: design_error(within, between, k, seeds) for k in counts}
    return _smallest(designs, change, level, power)


def _smallest(
    designs: Mapping[int, tuple[float, int]], change: float, level: float, power: float
) -> int | None:
    """Return the key of the first design, as error and degrees of freedom, that is enough."""
    for count, (error, degrees) in designs.items():
        if degrees >= MIN_DEGREES and detectable(error, degrees, level, power) <= change:
            return count
    return None


def newly_lost(before: Sequence[bool], after: Sequence[bool]) -> tuple[int, int, float]:
    """Compare losses on the same sequences.

    Returns:
        Numbers of sequences lost only after and only before, and the p-value of the former under
        equal probabilities.

    Source:
        McNemar, Psychometrika 1947, in its exact form.
    """
    gone = sum(b and not a for a, b in zip(before, after, strict=True))
    back = sum(a and not b for a, b in zip(before, after, strict=True))
    changed = gone + back
    p = stats.binomtest(gone, changed, 0.5, alternative="greater").pvalue if changed else 1.0
    return gone, back, float(p)


def _quantile(probability: float, degrees: int) -> float:
    return float(stats.t.ppf(probability, degrees)) if degrees >= 1 else np.nan
