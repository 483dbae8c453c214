"""A network of roads or corridors, and the graph of its travel times."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trials.navigation.adjacency import Adjacency, adjacency
from vo.contract.arrays import Array

Road = tuple[int, int]
"""Indices of the node that a road leaves and of the node that it enters."""


@dataclass(frozen=True)
class Network:
    """Nodes and one-way roads between them; a two-way road is listed in both directions.

    Attributes:
        names: Names of the n nodes.
        xy_m: (n, 2) positions.
        lengths_m: Length of each road, at least the straight distance.
        top_speed_mps: Speed of the vehicle on every road.
        start: Node where drives begin; None for a random one.
        goal: Node where drives end; None for a random one.
    """

    names: tuple[str, ...]
    xy_m: Array
    lengths_m: Mapping[Road, float]
    top_speed_mps: float
    start: int | None = None
    goal: int | None = None

    @cached_property
    def index(self) -> dict[Road, int]:
        """Number of each road, in the order of `lengths_m`."""
        return {road: k for k, road in enumerate(self.lengths_m)}

    @cached_property
    def direct_s(self) -> Array:
        """(n, n) travel times along straight lines at top speed."""
        distances_m = np.linalg.norm(self.xy_m[:, None] - self.xy_m[None], axis=2)
        return distances_m / self.top_speed_mps

    def drive_s(self, road: Road) -> float:
        """Travel time of a road at top speed."""
        return self.lengths_m[road] / self.top_speed_mps

    def graph(self, waits_s: Array) -> Adjacency:
        """Build the graph of travel times without queues, given the (n,) waits at the nodes.

        A road costs its length over the top speed plus the wait at its end. The heuristic, the
        straight distance over the top speed, never exceeds the cost.
        """
        roads = tuple(self.lengths_m)
        costs_s = [self.drive_s(road) + float(waits_s[road[1]]) for road in roads]
        return adjacency(roads, np.array(costs_s), self.direct_s)
