"""Attribution of the drift to stages: Shapley values over oracles.

The drift v(S) is measured with the truth in place of every combination S of stages. The share of a
stage is the reduction of the drift by its truth, averaged over all orders of replacement (Shapley,
A value for n-person games, 1953); so the shares and the drift with all truths add up to the drift.
A share is negative where the errors of a stage compensate those of others, so that its truth alone
increases the drift.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from trials.evaluation.intervals import Interval
from vo.contract.arrays import Array, Indices

Coalition = frozenset[str]
BLOCK_M = 1.0
"""Block length of the bootstrap, metres: neighbouring segments overlap and are drawn together."""
MIN_BLOCKS = 3
"""Number of blocks below which no interval is given."""
RESAMPLES, CONFIDENCE = 2000, 0.95
REMAINDER = "not separated"
"""Name of the drift that remains with the truth in every stage: refinement and sampling."""


@dataclass(frozen=True)
class SegmentDrifts:
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
    """Contribution of a stage, or REMAINDER, to the drift: percentage points, and their ratio."""

    stage: str
    drift: Interval
    share: Interval


@dataclass(frozen=True)
class Attribution:
    """Shares of the stages in the drift of several sequences; intervals are at CONFIDENCE.

    Attributes:
        drift: Mean over sequences, %.
        shares: One for each stage, and REMAINDER last; they add up to the drift.
        by_segment: Name of a sequence to its (K,) `at_m` and the (P + 1, K) shares of its segments
            in percentage points, rows as in `shares`.
    """

    drift: Interval
    shares: tuple[Share, ...]
    by_segment: Mapping[str, tuple[Array, Array]]


def coalitions(stages: Sequence[str]) -> list[Coalition]:
    """Return every combination of stages, the empty one first."""
    return [frozenset(x) for n in range(len(stages) + 1) for x in combinations(stages, n)]


def shapley(percent: Mapping[Coalition, Array], stages: Sequence[str]) -> Array:
    """Return shares (P + 1, K) of P stages and, in the last row, of the remainder.

    `percent` maps every combination of the stages to the (K,) drift, %.
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


def attribute(sequences: Sequence[SegmentDrifts], stages: Sequence[str]) -> Attribution:
    """Attribute the drift of sequences of equal weight, at least one, to stages.

    Intervals are percentiles of a bootstrap over sequences and, within each, over blocks of its
    path; for a single sequence they cover only the variation along its path. They are NaN if there
    are fewer than MIN_BLOCKS blocks in total.

    Source:
        Davison and Hinkley, Bootstrap Methods and their Application, 1997, sections 3.8 and 8.2.3.
    """
    by_segment = {x.name: (x.at_m, shapley(x.percent, stages)) for x in sequences}
    drawn = _resampled(list(by_segment.values()), np.random.default_rng(0))
    if sum(_block_count(x.at_m) for x in sequences) < MIN_BLOCKS:
        drawn = np.full_like(drawn, np.nan)
    means = np.array([shares.mean(axis=1) for _, shares in by_segment.values()]).mean(axis=0)
    drift, drifts = means.sum(), drawn.sum(axis=1)
    names = (*stages, REMAINDER)
    shares = tuple(
        Share(name, _interval(mean, some), _interval(mean / drift, some / drifts))
        for name, mean, some in zip(names, means, drawn.T, strict=True)
    )
    return Attribution(_interval(drift, drifts), shares, by_segment)


def summarize(attribution: Attribution) -> str:
    """Describe the shares in a sentence, the largest share first."""
    ordered = sorted(attribution.shares[:-1], key=lambda x: -x.share.value)
    parts = [f"{_percent(x)} from {x.stage}" for x in ordered if round(100 * x.share.value) > 0]
    parts[:1] = [f"{_percent(ordered[0])} of the drift comes from {ordered[0].stage}"]
    negative = [x for x in ordered if round(100 * x.share.value) < 0]
    parts += [f"errors of {x.stage} compensate {_percent(x, -1)} of it" for x in negative]
    rest = f"{_percent(attribution.shares[-1])} is {REMAINDER} (refinement, sampling)"
    return f"{', '.join(parts)}; {rest}."


def _percent(share: Share, sign: int = 1) -> str:
    low, high = sorted(100 * sign * x for x in (share.share.low, share.share.high))
    between = f" ({low:.0f} to {high:.0f})" if np.isfinite(low) else ""
    return f"{100 * sign * share.share.value:.0f} %{between}"


def _resampled(sequences: Sequence[tuple[Array, Array]], rng: np.random.Generator) -> Array:
    """Return means (RESAMPLES, P + 1) of shares over resampled sequences and blocks."""
    drawn = np.array(
        [
            [shares[:, _blocks(at_m, rng)].mean(axis=1) for _ in range(RESAMPLES)]
            for at_m, shares in sequences
        ]
    )
    chosen = rng.integers(len(sequences), size=(RESAMPLES, len(sequences)))
    return drawn[chosen, np.arange(RESAMPLES)[:, None]].mean(axis=1)


def _blocks(at_m: Array, rng: np.random.Generator) -> Indices:
    """Return rows of (K,) segments, drawn in blocks of BLOCK_M that wrap around the end."""
    count = _block_count(at_m)
    length = -(-len(at_m) // count)
    starts = rng.integers(len(at_m), size=count)
    rows = (starts[:, None] + np.arange(length)) % len(at_m)
    return rows.ravel()[: len(at_m)]


def _block_count(at_m: Array) -> int:
    return max(1, round(float(at_m[-1] - at_m[0]) / BLOCK_M))


def _interval(value: float, resampled: Array) -> Interval:
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(value), float(low), float(high))
