"""Travel times with all strategies: over node delay, over queuing delay, and at random."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trials.navigation import PlanningError
from trials.routing.drive import STRATEGIES, Delays, drive, undelayed_s
from trials.routing.generation import SMALL_CONGESTED
from trials.routing.network import Network, Road
from vo.contract.arrays import Array

NODE_MAX_S, QUEUE_MAX_S = 180.0, 420.0
"""Longest wait at a node and longest queuing delay."""
NODE_S, QUEUE_S = NODE_MAX_S / 2, QUEUE_MAX_S / 2
"""Wait at the nodes while queues are varied, and queuing delay while waits are varied."""
STEPS = 9
MIN_DISTANCE = 0.4
"""Smallest distance of random ends over the extent of the network."""
MAX_TRIES = 10_000

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
    """Travel times over one kind of delay.

    Attributes:
        delays_s: (k,) the delay that is varied.
        times_s: (4, k, cases) by STRATEGIES.
    """

    delays_s: Array
    times_s: Array


@dataclass(frozen=True)
class Randomised:
    """Travel times with random ends, waits and queues.

    Attributes:
        free_s: (cases,) without delays.
        times_s: (4, cases) by STRATEGIES.
    """

    free_s: Array
    times_s: Array

    @property
    def increase_percent(self) -> Array:
        """(4, cases) increase over the undelayed time."""
        return 100 * (self.times_s / self.free_s - 1)


@dataclass(frozen=True)
class Study:
    """Sweeps on one network.

    Attributes:
        network: The roads.
        cases: The drives.
        free: Travel times without waits and queues.
        node: Sweep over the wait at every node.
        queue: Sweep over the delay on congested roads.
    """

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
    """Sample ends, unless the network sets them, and roads that become congested.

    Queues arise at any time of the undelayed drive, in both directions of a road together.

    Args:
        network: The roads.
        congested: Ratio of congested roads to all roads.
        rng: Source of the samples.

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
