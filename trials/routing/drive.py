"""A drive through a network in which roads become congested."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np

from trials.navigation import PlanningError
from trials.navigation.dstar_lite import DStarLite
from trials.routing.network import Network, Road
from vo.contract.arrays import Array


@dataclass(frozen=True)
class Strategy:
    """Routing strategy of a vehicle.

    Attributes:
        dynamic: The route is replanned at every node with the queues reported by then; otherwise
            it is planned once, without queues.
        clearing: The nodes of the planned route are cleared ahead.
    """

    dynamic: bool
    clearing: bool

    @property
    def name(self) -> str:
        """Name in tables and legends."""
        return ("dynamic" if self.dynamic else "static") + (" + clearing" if self.clearing else "")


STRATEGIES = (
    Strategy(dynamic=False, clearing=False),
    Strategy(dynamic=True, clearing=False),
    Strategy(dynamic=False, clearing=True),
    Strategy(dynamic=True, clearing=True),
)


@dataclass(frozen=True)
class Delays:
    """Delays of a drive.

    Attributes:
        waits_s: (n,) wait at each node that is not cleared; start and goal cost no wait.
        queues: By road, the time after departure at which a queue arises, s, and the delay of
            a vehicle that enters the road from then on, s.
        lead_s: Time from the request until a node is clear; an earlier arrival waits for the rest.
    """

    waits_s: Array
    queues: Mapping[Road, tuple[float, float]]
    lead_s: float


@dataclass(frozen=True)
class Drive:
    """Travel time from start to goal, and the nodes passed, start and goal included."""

    time_s: float
    nodes: tuple[int, ...]


def drive(network: Network, delays: Delays, start: int, goal: int, strategy: Strategy) -> Drive:
    """Drive from start to goal; raises a PlanningError if there is no path."""
    route = Route(network, delays, start, goal, strategy)
    time_s, nodes, requested_s = 0.0, [start], dict[int, float]()
    while nodes[-1] != goal:
        ahead = route.ahead(nodes[-1], time_s)
        for node in ahead:
            requested_s.setdefault(node, time_s)
        road = nodes[-1], ahead[0]
        nodes.append(ahead[0])
        onset_s, queue_s = delays.queues.get(road, (inf, 0.0))
        time_s += network.drive_s(road) + (queue_s if onset_s <= time_s else 0.0)
        if nodes[-1] != goal:
            wait_s = float(delays.waits_s[nodes[-1]])
            if strategy.clearing:
                wait_s = min(wait_s, max(0.0, requested_s[nodes[-1]] + delays.lead_s - time_s))
            time_s += wait_s
    return Drive(time_s, tuple(nodes))


def undelayed_s(network: Network, start: int, goal: int) -> float:
    """Compute the travel time without waits and queues; raises as `drive`."""
    free = Delays(np.zeros(len(network.names)), {}, 0.0)
    return drive(network, free, start, goal, STRATEGIES[0]).time_s


class Route:
    """The cheapest route from start to goal, which D* Lite repairs at every node.

    A static route ignores queues, one with clearing ignores waits.

    Raises:
        PlanningError: If there is no path.
    """

    def __init__(
        self, network: Network, delays: Delays, start: int, goal: int, strategy: Strategy
    ) -> None:
        self.network, self.start, self.strategy = network, start, strategy
        waits_s = np.zeros_like(delays.waits_s) if strategy.clearing else delays.waits_s.copy()
        waits_s[goal] = 0.0
        queues = delays.queues.items() if strategy.dynamic else ()
        coming = ((onset_s, road, queue_s) for road, (onset_s, queue_s) in queues)
        self._coming = sorted(coming, reverse=True)
        self._graph = network.graph(waits_s)
        self._planner = DStarLite(self._graph, len(network.names), start, goal)
        if self._planner.cost == inf:
            raise PlanningError(f"no path from {network.names[start]} to {network.names[goal]}")

    def ahead(self, node: int, time_s: float) -> list[int]:
        """List the nodes of the best route after `node`, given all queues reported by a time."""
        changed: list[int] = []
        while self._coming and self._coming[-1][0] <= time_s:
            _, road, queue_s = self._coming.pop()
            self._graph.costs[self.network.index[road]] += queue_s
            changed.append(road[0])
        self._planner.move(node)
        self._planner.replan(np.array(changed, dtype=np.int64))
        return self._planner.path()[1:]
