"""Travel times with all strategies, over both delays and at random, and hypotheses on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.navigation import PlanningError
from trials.routing.drive import STRATEGIES, Delays, Strategy, drive, undelayed_s
from trials.routing.network import SMALL_CONGESTED, Network, Road
from vo.contract.arrays import Array

NODE_MAX_S, QUEUE_MAX_S = 180.0, 420.0
"""Longest wait at a node and longest queuing delay."""
NODE_S, QUEUE_S = NODE_MAX_S / 2, QUEUE_MAX_S / 2
"""Wait at the nodes while queues are varied, and queuing delay while waits are varied."""
STEPS = 9
MIN_DISTANCE = 0.4
"""Smallest distance of random ends over the extent of the network."""
MAX_TRIES = 10_000
SAME_S = 1e-6
FLAT = 0.1
"""Largest growth of dynamic over that of static routing with which dynamic routing is flat."""

Done = Callable[[object], None]


@dataclass(frozen=True)
class Case:
    """One drive for all strategies.

    Attributes:
        start: Node.
        goal: Node.
        onsets_s: By congested road, the time after departure at which its queue arises.
        free_s: Travel time without delays.
    """

    start: int
    goal: int
    onsets_s: Mapping[Road, float]
    free_s: float


@dataclass(frozen=True)
class Sweep:
    """Travel times (4, k, cases), by STRATEGIES, over the (k,) values of one kind of delay."""

    delays_s: Array
    times_s: Array


@dataclass(frozen=True)
class Randomised:
    """Random drives: times (cases,) without delays, and (4, cases) by STRATEGIES."""

    free_s: Array
    times_s: Array

    @property
    def increase_percent(self) -> Array:
        """(4, cases) increase over the undelayed time."""
        return 100 * (self.times_s / self.free_s - 1)


@dataclass(frozen=True)
class Study:
    """Travel times on one network: without delays, over node delay, and over queuing delay."""

    network: Network
    cases: Sequence[Case]
    free: Randomised
    node: Sweep
    queue: Sweep


def study(network: Network, cases: Sequence[Case], lead_s: float, done: Done) -> Study:
    """Drive all cases without delays and in both sweeps; `done` is called with every drive."""
    none = Delays(np.zeros(len(network.names)), {}, lead_s)
    times_s = [travel_times(network, case, none) for case in cases]
    free = Randomised(np.array([case.free_s for case in cases]), np.array(times_s).T)
    node, queue = (sweep(network, cases, over, lead_s, done) for over in ("node", "queue"))
    return Study(network, cases, free, node, queue)


def small_case(network: Network) -> Case:
    """Make the drive of the small network: a queue on the shorter way just after departure."""
    start, goal = network.start or 0, network.goal or len(network.names) - 1
    return Case(start, goal, {SMALL_CONGESTED: 1.0}, undelayed_s(network, start, goal))


def random_case(network: Network, congested: float, rng: np.random.Generator) -> Case:
    """Sample ends, unless the network sets them, and a ratio of roads that become congested.

    Queues arise at any time of the undelayed drive, in both directions of a road together.

    Raises:
        PlanningError: If no two distant nodes are connected, or the given ones are not.
    """
    start, goal, free_s = _sample_ends(network, rng)
    onsets_s: dict[Road, float] = {}
    for a, b in network.lengths_m:
        if a < b or (b, a) not in network.lengths_m:
            is_congested, onset_s = rng.random() < congested, float(rng.uniform(0, free_s))
            if is_congested:
                both = ((a, b), (b, a)) if (b, a) in network.lengths_m else ((a, b),)
                onsets_s |= dict.fromkeys(both, onset_s)
    return Case(start, goal, onsets_s, free_s)


def _sample_ends(network: Network, rng: np.random.Generator) -> tuple[int, int, float]:
    if network.start is not None and network.goal is not None:
        return network.start, network.goal, undelayed_s(network, network.start, network.goal)
    min_s = MIN_DISTANCE * network.direct_s.max()
    n = len(network.names)
    for _ in range(MAX_TRIES):
        start = int(rng.integers(n)) if network.start is None else network.start
        goal = int(rng.integers(n)) if network.goal is None else network.goal
        if start != goal and network.direct_s[start, goal] >= min_s:
            try:
                return start, goal, undelayed_s(network, start, goal)
            except PlanningError:
                continue
    raise PlanningError("no two distant nodes are connected; name a start and a goal")


def travel_times(network: Network, case: Case, delays: Delays) -> Array:
    """(4,) travel times of one drive with each strategy, s."""
    return np.array([drive(network, delays, case.start, case.goal, s).time_s for s in STRATEGIES])


def sweep(network: Network, cases: Sequence[Case], over: str, lead_s: float, done: Done) -> Sweep:
    """Vary the wait at every node (`over` is "node") or the delay on congested roads ("queue")."""
    delays_s = np.linspace(0, NODE_MAX_S if over == "node" else QUEUE_MAX_S, STEPS)
    times_s = np.empty((len(STRATEGIES), STEPS, len(cases)))
    for k, delay_s in enumerate(delays_s.tolist()):
        node_s, queue_s = (delay_s, QUEUE_S) if over == "node" else (NODE_S, delay_s)
        waits_s = np.full(len(network.names), node_s)
        for i, case in enumerate(cases):
            queues = {road: (onset_s, queue_s) for road, onset_s in case.onsets_s.items()}
            times_s[:, k, i] = travel_times(network, case, Delays(waits_s, queues, lead_s))
            done(case)
    return Sweep(delays_s, times_s)


def randomised(
    network: Network,
    cases: Sequence[Case],
    lead_s: float,
    rng: np.random.Generator,
    done: Done,
    known_s: float | None = None,
) -> Randomised:
    """Sample each node's wait and each queue up to the longest; `done` is called with every drive.

    Queues arise on the way, or all at the time `known_s` after departure.
    """
    times_s = np.empty((len(STRATEGIES), len(cases)))
    for i, case in enumerate(cases):
        waits_s = rng.uniform(0, NODE_MAX_S, len(network.names))
        queues = {
            road: (onset_s if known_s is None else known_s, float(rng.uniform(0, QUEUE_MAX_S)))
            for road, onset_s in case.onsets_s.items()
        }
        times_s[:, i] = travel_times(network, case, Delays(waits_s, queues, lead_s))
        done(case)
    return Randomised(np.array([case.free_s for case in cases]), times_s)


@dataclass(frozen=True)
class Verdict:
    """A hypothesis, whether it holds, and the figures, with those where it does not hold."""

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
