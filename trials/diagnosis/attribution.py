"""How much of the drift each stage is to blame for: Shapley values over oracles.

The drift v(S) is measured with the truth in the place of every combination S of stages. What a
stage is to blame for is what its truth takes off the drift, averaged over all orders in which
truths can be put in (Shapley, A value for n-person games, 1953); so the shares and what remains
with all truths add up to the drift. A share is negative where a stage's errors make up for
others', so that its truth alone makes the drift worse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from vo.contract.arrays import Array, Indices

Coalition = frozenset[str]
BLOCK_M = 1.0
"""Neighbouring segments share their path, so this much of it is drawn together."""
LEAST_BLOCKS = 3
"""Fewer in all, and there is no interval."""
RESAMPLES, CONFIDENCE = 2000, 0.95
REST = "not separated"
"""What remains with the truth in the place of every stage: refinement and sampling."""


@dataclass(frozen=True)
class Sequence1m:
    """Drift of one sequence over segments of 1 m, the same for every combination of oracles.

    Attributes:
        name: Of the dataset.
        at_m: (K,) true path before each segment, ascending.
        percent: Combination to (K,) drift, %.
    """

    name: str
    at_m: Array
    percent: Mapping[Coalition, Array]


@dataclass(frozen=True)
class Share:
    """What one stage is to blame for.

    Attributes:
        stage: Name, or REST.
        drift: Percentage points of drift.
        drift_interval: At CONFIDENCE.
        share: Of the whole drift.
        share_interval: At CONFIDENCE.
    """

    stage: str
    drift: float
    drift_interval: tuple[float, float]
    share: float
    share_interval: tuple[float, float]


@dataclass(frozen=True)
class Attribution:
    """Where the drift of some sequences comes from.

    Attributes:
        drift: Mean over sequences, %.
        drift_interval: At CONFIDENCE.
        shares: One for each stage, and REST last; they add up to the drift.
        by_segment: Name of a sequence to its (K,) `at_m` and the (P + 1, K) shares of its segments
            in percentage points, rows as in `shares`.
    """

    drift: float
    drift_interval: tuple[float, float]
    shares: tuple[Share, ...]
    by_segment: Mapping[str, tuple[Array, Array]]


def coalitions(stages: Sequence[str]) -> list[Coalition]:
    """Every combination, the empty one first."""
    return [frozenset(x) for n in range(len(stages) + 1) for x in combinations(stages, n)]


def shapley(percent: Mapping[Coalition, Array], stages: Sequence[str]) -> Array:
    """Shares (P + 1, K) of P stages, and what remains.

    Args:
        percent: Every combination of the stages to (K,) drift.
        stages: P names.
    """
    n = len(stages)
    shares: list[Array] = []
    for stage in stages:
        gain = np.zeros_like(percent[frozenset()])
        for others in coalitions([x for x in stages if x != stage]):
            orders = factorial(len(others)) * factorial(n - len(others) - 1) / factorial(n)
            gain = gain + orders * (percent[others] - percent[others | {stage}])
        shares.append(gain)
    return np.array([*shares, percent[frozenset(stages)]])


def attribute(sequences: Sequence[Sequence1m], stages: Sequence[str]) -> Attribution:
    """Share out the drift of paired sequences, each counting once.

    Intervals are percentiles of a bootstrap over sequences and, within each, over blocks of its
    path: of one sequence they say how much its stretches differ, not how much drives do. They are
    NaN where there are fewer than LEAST_BLOCKS of those.

    Args:
        sequences: At least one.
        stages: Names of those replaced in the combinations.

    Source:
        Davison and Hinkley, Bootstrap Methods and their Application, 1997, sections 3.8 and 8.2.3.
    """
    by_segment = {x.name: (x.at_m, shapley(x.percent, stages)) for x in sequences}
    drawn = _resampled(list(by_segment.values()), np.random.default_rng(0))
    if sum(_block_count(x.at_m) for x in sequences) < LEAST_BLOCKS:
        drawn = np.full_like(drawn, np.nan)
    means = np.array([shares.mean(axis=1) for _, shares in by_segment.values()]).mean(axis=0)
    drift, drifts = means.sum(), drawn.sum(axis=1)
    names = (*stages, REST)
    shares = tuple(
        Share(name, float(mean), _interval(some), float(mean / drift), _interval(some / drifts))
        for name, mean, some in zip(names, means, drawn.T, strict=True)
    )
    return Attribution(float(drift), _interval(drifts), shares, by_segment)


def sentence(attribution: Attribution) -> str:
    """Say where the drift comes from, the largest share first."""
    blamed = sorted(attribution.shares[:-1], key=lambda x: -x.share)
    parts = [f"{_percent(x)} from {x.stage}" for x in blamed if round(100 * x.share) > 0]
    parts[:1] = [f"{_percent(blamed[0])} of the drift comes from {blamed[0].stage}"]
    helpers = [x for x in blamed if round(100 * x.share) < 0]
    if helpers:
        parts += [f"{x.stage} makes up for {_percent(x, -1)} of it" for x in helpers]
    return (
        f"{', '.join(parts)}; {_percent(attribution.shares[-1])} is {REST} (refinement, sampling)."
    )


def _percent(share: Share, sign: int = 1) -> str:
    low, high = sorted(100 * sign * x for x in share.share_interval)
    between = f" ({low:.0f} to {high:.0f})" if np.isfinite(low) else ""
    return f"{100 * sign * share.share:.0f} %{between}"


def _resampled(sequences: Sequence[tuple[Array, Array]], rng: np.random.Generator) -> Array:
    """Means (RESAMPLES, P + 1) of shares over sequences and blocks drawn with replacement."""
    drawn = np.array(
        [
            [shares[:, _blocks(at_m, rng)].mean(axis=1) for _ in range(RESAMPLES)]
            for at_m, shares in sequences
        ]
    )
    chosen = rng.integers(len(sequences), size=(RESAMPLES, len(sequences)))
    return drawn[chosen, np.arange(RESAMPLES)[:, None]].mean(axis=1)


def _blocks(at_m: Array, rng: np.random.Generator) -> Indices:
    """Rows of (K,) segments, drawn in blocks of BLOCK_M that wrap around the end."""
    count = _block_count(at_m)
    length = -(-len(at_m) // count)
    starts = rng.integers(len(at_m), size=count)
    rows = (starts[:, None] + np.arange(length)) % len(at_m)
    return rows.ravel()[: len(at_m)]


def _block_count(at_m: Array) -> int:
    return max(1, round(float(at_m[-1] - at_m[0]) / BLOCK_M))


def _interval(values: Array) -> tuple[float, float]:
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)
