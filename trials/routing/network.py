"""A road or corridor network, and what its roads cost at a moment."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trials.navigation.graph import Graph
from vo.contract.arrays import Array

Road = tuple[int, int]
"""Node it leaves and node it enters, by index."""


@dataclass(frozen=True)
class Network:
    """Nodes and one-way roads between them; a road for both ways counts twice.

    Attributes:
        names: Of the nodes.
        xy_m: (n, 2) where they are.
        lengths_m: Of each road, no less than the straight distance.
        top_speed_mps: Of the vehicle, on every road.
        start: Node where drives begin; None for a random one.
        goal: Node where they end; None for a random one.
    """

    names: tuple[str, ...]
    xy_m: Array
    lengths_m: Mapping[Road, float]
    top_speed_mps: float
    start: int | None = None
    goal: int | None = None

    @cached_property
    def successors(self) -> list[list[int]]:
        """Of each node, those that can be entered from it."""
        return [[b for a, b in self.lengths_m if a == node] for node in range(len(self.names))]

    @cached_property
    def predecessors(self) -> list[list[int]]:
        """Of each node, those from which it can be entered."""
        return [[a for a, b in self.lengths_m if b == node] for node in range(len(self.names))]

    @cached_property
    def direct_s(self) -> Array:
        """(n, n) travel times as the crow flies at top speed."""
        apart_m = np.linalg.norm(self.xy_m[:, None] - self.xy_m[None], axis=2)
        return apart_m / self.top_speed_mps

    def drive_s(self, road: Road) -> float:
        """Travel time of a road at top speed."""
        return self.lengths_m[road] / self.top_speed_mps


@dataclass(frozen=True)
class RoadCosts(Graph[int]):
    """What the roads cost a vehicle that plans now; `queues_s` may grow in place.

    A road costs its length over the top speed, the queue on it, and the waiting at its end,
    except at the goal. The heuristic, distance over top speed, is never more.

    Attributes:
        network: The roads.
        waits_s: (n,) expected at each node.
        goal: Where no one waits.
        queues_s: Delay by road, as reported so far.
    """

    network: Network
    waits_s: Array
    goal: int
    queues_s: dict[Road, float] = field(default_factory=dict[Road, float])

    def successors(self, node: int, /) -> Iterable[int]:
        """Nodes that can be entered from `node`."""
        return self.network.successors[node]

    def predecessors(self, node: int, /) -> Iterable[int]:
        """Nodes from which `node` can be entered."""
        return self.network.predecessors[node]

    def cost(self, a: int, b: int, /) -> float:
        """Seconds from leaving `a` to leaving `b`."""
        wait_s = 0.0 if b == self.goal else float(self.waits_s[b])
        return self.network.drive_s((a, b)) + self.queues_s.get((a, b), 0.0) + wait_s

    def heuristic(self, a: int, b: int, /) -> float:
        """Seconds as the crow flies."""
        return float(self.network.direct_s[a, b])
