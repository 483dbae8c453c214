"""Hypotheses of the routing study, tested on its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.routing.drive import STRATEGIES, Strategy
from trials.routing.study import QUEUE_S, Randomised, Study, Sweep
from vo.contract.arrays import Array

SAME_S = 1e-6
FLAT = 0.1
"""Largest growth of dynamic over that of static routing with which dynamic routing is flat."""


@dataclass(frozen=True)
class Verdict:
    """Result of one hypothesis.

    Attributes:
        claim: The hypothesis.
        holds: Whether it holds.
        because: Figures, and where it does not hold.
    """

    claim: str
    holds: bool
    because: str


def _row(times_s: Array, dynamic: bool, clearing: bool) -> Array:
    return times_s[STRATEGIES.index(Strategy(dynamic, clearing))]


def equal_without_congestion(studies: Mapping[str, Study]) -> Verdict:
    """Test whether static and dynamic agree without queues, and all four without waits as well."""
    queueless = max(
        float(np.abs(_row(s.queue.times_s, True, c)[0] - _row(s.queue.times_s, False, c)[0]).max())
        for s in studies.values()
        for c in (False, True)
    )
    free = max(float(np.abs(s.free.times_s - s.free.free_s).max()) for s in studies.values())
    return Verdict(
        "all are equal without congestion",
        max(queueless, free) < SAME_S,
        f"largest difference of static and dynamic without queues {queueless:.1g} s, of all four "
        f"from the undelayed time without waits too {free:.1g} s",
    )


def flat(studies: Mapping[str, Study]) -> Verdict:
    """Test whether static routing grows with the queues, and dynamic routing does not."""
    holds, parts = True, list[str]()
    for name, study in studies.items():
        for clearing in (False, True):
            static_min, dynamic_min = (
                _growth_s(_row(study.queue.times_s, dynamic, clearing)) / 60
                for dynamic in (False, True)
            )
            holds &= static_min > 0 and dynamic_min <= FLAT * static_min
            label = f"{name}{', cleared' if clearing else ''}"
            parts.append(f"{label}: static {static_min:+.2f} min, dynamic {dynamic_min:+.2f} min")
    why = f"growth over the upper half of the queuing delays; {'; '.join(parts)}"
    return Verdict("dynamic stays flat where static grows with queuing delay", holds, why)


def _growth_s(times_s: Array) -> float:
    """Growth of the mean of (k, cases) times over the upper half of the delays."""
    means_s = times_s.mean(axis=1)
    return float(means_s[-1] - means_s[len(means_s) // 2])


def clearing_saves_more(drives: Randomised, node: Sweep) -> Verdict:
    """Compare clearing alone with dynamic routing alone, in random drives and over node delay."""
    cleared = _row(drives.times_s, False, True)
    rerouted = _row(drives.times_s, True, False)
    more_min = mean_interval((rerouted - cleared) / 60)
    gain_s = (_row(node.times_s, True, False) - _row(node.times_s, False, True)).mean(axis=1)
    return Verdict(
        "clearing alone saves more than dynamic routing alone",
        more_min.low > 0,
        f"by {more_min.text(1)} min a drive more, 95 % interval; with queues of "
        f"{QUEUE_S / 60:.1f} min it {_break_even(node.delays_s, gain_s)}",
    )


def _break_even(delays_s: Array, gain_s: Array) -> str:
    if gain_s[0] >= 0:
        return "does at every node delay"
    if gain_s.max() < 0:
        return "does not at any node delay"
    k = int(np.argmax(gain_s >= 0))
    at_s = float(np.interp(0, gain_s[k - 1 : k + 1], delays_s[k - 1 : k + 1]))
    return f"does from {at_s:.0f} s of waiting at every node, below that it saves less"


def both_never_worse(during: Randomised, before: Randomised, sweeps: Sequence[Sweep]) -> Verdict:
    """Compare dynamic routing with clearing with either alone, drive by drive."""
    excess_s = {
        "random drives with queues arising on the way": _excess_s(during.times_s),
        "with all queues there at departure": _excess_s(before.times_s),
        "in the sweeps, queues arising on the way": np.concatenate(
            [_excess_s(s.times_s).ravel() for s in sweeps]
        ),
    }
    parts: list[str] = []
    for name, excess in excess_s.items():
        worse = int((excess > SAME_S).sum())
        part = f"{name}: worse in {worse} of {excess.size}"
        parts.append(part + (f", at most by {excess.max() / 60:.1f} min" if worse else ""))
    holds = all(bool((x <= SAME_S).all()) for x in excess_s.values())
    why = "" if holds else "; it can be where a queue arises after the vehicle has turned off"
    saved_min = 0.0 - _excess_s(during.times_s).mean() / 60
    mean = f"; on average {saved_min:.1f} min faster than the better of the two"
    return Verdict(
        "both together are never worse than either", holds, "; ".join(parts) + why + mean
    )


def _excess_s(times_s: Array) -> Array:
    either = np.minimum(_row(times_s, True, False), _row(times_s, False, True))
    return _row(times_s, True, True) - either
