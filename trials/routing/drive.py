"""A drive through a network while congestion arises."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Protocol

import numpy as np

from trials.navigation.astar import astar
from trials.navigation.dstar_lite import DStarLite
from trials.navigation.graph import PlanningError
from trials.routing.network import Network, Road, RoadCosts
from vo.contract.arrays import Array


@dataclass(frozen=True)
class Strategy:
    """How a vehicle is routed.

    Attributes:
        dynamic: Replan at every node with the queues reported by then; else the route is planned
            once, from a map without queues.
        clearing: The nodes of the planned route are cleared ahead.
    """

    dynamic: bool
    clearing: bool

    @property
    def name(self) -> str:
        """For tables and legends."""
        return ("dynamic" if self.dynamic else "static") + (" + clearing" if self.clearing else "")


STRATEGIES = (
    Strategy(dynamic=False, clearing=False),
    Strategy(dynamic=True, clearing=False),
    Strategy(dynamic=False, clearing=True),
    Strategy(dynamic=True, clearing=True),
)


@dataclass(frozen=True)
class Delays:
    """What lies in the way of a drive.

    Attributes:
        waits_s: (n,) waiting at each node that is not cleared; none at start and goal.
        queues: By road, when after departure a queue arises, s, and the delay from then on, s;
            it counts for whoever enters the road later.
        lead_s: How long after the request a node is clear; who comes earlier waits for the rest.
    """

    waits_s: Array
    queues: Mapping[Road, tuple[float, float]]
    lead_s: float


@dataclass(frozen=True)
class Drive:
    """What came of it.

    Attributes:
        time_s: From leaving the start to reaching the goal.
        nodes: Passed, start and goal included.
    """

    time_s: float
    nodes: tuple[int, ...]


def drive(network: Network, delays: Delays, start: int, goal: int, strategy: Strategy) -> Drive:
    """Drive from start to goal.

    Raises:
        PlanningError: If there is no way.
    """
    route = plan_route(network, delays, start, goal, strategy)
    time_s, nodes, requested_s = 0.0, [start], dict[int, float]()
    while nodes[-1] != goal:
        ahead = route.ahead(nodes[-1], time_s)
        for node in ahead:
            requested_s.setdefault(node, time_s)
        road = nodes[-1], ahead[0]
        nodes.append(ahead[0])
        since_s, queue_s = delays.queues.get(road, (inf, 0.0))
        time_s += network.drive_s(road) + (queue_s if since_s <= time_s else 0.0)
        if nodes[-1] != goal:
            wait_s = float(delays.waits_s[nodes[-1]])
            if strategy.clearing:
                wait_s = min(wait_s, max(0.0, requested_s[nodes[-1]] + delays.lead_s - time_s))
            time_s += wait_s
    return Drive(time_s, tuple(nodes))


def undelayed_s(network: Network, start: int, goal: int) -> float:
    """Travel time without waits and queues.

    Raises:
        PlanningError: If there is no way.
    """
    free = Delays(np.zeros(len(network.names)), {}, 0.0)
    return drive(network, free, start, goal, Strategy(dynamic=False, clearing=False)).time_s


class Route(Protocol):
    """A way through a network that may change while it is driven."""

    def ahead(self, node: int, time_s: float) -> list[int]:
        """Nodes after `node`, which the vehicle leaves at a time."""
        ...


def plan_route(
    network: Network, delays: Delays, start: int, goal: int, strategy: Strategy
) -> Route:
    """Plan a drive.

    Raises:
        PlanningError: If there is no way.
    """
    expected_s = np.zeros_like(delays.waits_s) if strategy.clearing else delays.waits_s
    costs = RoadCosts(network, expected_s, goal)
    return _Dynamic(costs, delays, start) if strategy.dynamic else _Static(costs, start)


class _Static:
    """A route that is planned once."""

    def __init__(self, costs: RoadCosts, start: int) -> None:
        self._route, cost_s = astar(costs, start, costs.goal)
        _expect_way(costs, start, cost_s)

    def ahead(self, node: int, time_s: float) -> list[int]:
        """Nodes of the route after `node`."""
        return self._route[self._route.index(node) + 1 :]


class _Dynamic:
    """A route that D* Lite repairs at every node."""

    def __init__(self, costs: RoadCosts, delays: Delays, start: int) -> None:
        self._costs = costs
        self._coming = sorted(
            ((since_s, road, queue_s) for road, (since_s, queue_s) in delays.queues.items()),
            reverse=True,
        )
        self._planner = DStarLite(costs, start, costs.goal)
        _expect_way(costs, start, self._planner.cost)

    def ahead(self, node: int, time_s: float) -> list[int]:
        """Nodes of the best route after `node` with all queues that have arisen by now."""
        changed: list[int] = []
        while self._coming and self._coming[-1][0] <= time_s:
            _, road, queue_s = self._coming.pop()
            self._costs.queues_s[road] = queue_s
            changed.append(road[0])
        self._planner.move(node)
        self._planner.replan(changed)
        return self._planner.path()[1:]


def _expect_way(costs: RoadCosts, start: int, cost_s: float) -> None:
    if cost_s == inf:
        names = costs.network.names
        raise PlanningError(f"no way from {names[start]} to {names[costs.goal]}")
