"""Trips of the other traffic through a city, and lanes that are blocked on the way."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from trials.routing.city import City
from vo.contract.arrays import Array, Indices

ROUTE_SETS, ROUTE_JITTER = 12, 0.3
"""Number of costs of the roads from which drivers choose, and their largest relative deviation."""


Trip = tuple[float, tuple[str, ...]]
"""Departure, s, and roads of a vehicle."""


@dataclass(frozen=True)
class Demand:
    """Other traffic.

    Attributes:
        trips: Those of all vehicles, by departure.
        blocked: By road, the time after the urgent vehicle's departure, in durations of its
            undelayed drive, from which a vehicle that has broken down blocks the outer lane.
    """

    trips: tuple[Trip, ...]
    blocked: Mapping[str, float]


def make_demand(
    city: City, per_hour: float, end_s: float, blocked: float, rng: np.random.Generator
) -> Demand:
    """Sample trips from every entry to random others, and roads of which a lane becomes blocked.

    Vehicles arrive at an entry at random (Poisson); each drives the shortest path by one of several
    random costs of the roads. Trips do not depend on the ratio of blocked roads.

    Args:
        city: The grid.
        per_hour: Vehicles that enter at every entry in an hour.
        end_s: Time of the last departure.
        blocked: Ratio of roads between intersections of which a lane becomes blocked.
        rng: Source of randomness.
    """
    places = rng.random((2, len(city.roads))).tolist()
    inner = [road for road, ends in city.roads.items() if not {*ends} & {*city.entries}]
    blockages = {
        road: when
        for road, chance, when in zip(city.roads, *places, strict=True)
        if road in inner and chance < blocked
    }
    roads = tuple(city.roads)
    sources = [x for x in roads if city.roads[x][0] in city.entries]
    sinks = [x for x in roads if city.roads[x][1] in city.entries]
    before = [_predecessors(city, sources, rng) for _ in range(ROUTE_SETS)]
    trips: list[Trip] = []
    for row, source in enumerate(sources):
        count = rng.poisson(per_hour * end_s / 3600)
        for depart_s in np.sort(rng.uniform(0, end_s, count)).tolist():
            tree = before[int(rng.integers(ROUTE_SETS))][row]
            way = _path(tree, city.index[source], city.index[sinks[int(rng.integers(len(sinks)))]])
            if way:
                trips.append((depart_s, tuple(roads[k] for k in way)))
    return Demand(tuple(sorted(trips)), blockages)


def _predecessors(city: City, sources: list[str], rng: np.random.Generator) -> Indices:
    """(sources, roads) road before each road on the shortest path from each source; < 0 if none."""
    costs: Array = 1 + rng.uniform(-ROUTE_JITTER, ROUTE_JITTER, len(city.roads))
    arcs = np.array([(city.index[a], city.index[b]) for a, b in city.turns])
    matrix = csr_matrix((costs[arcs[:, 1]], arcs.T), shape=(len(city.roads),) * 2)
    rows = [city.index[x] for x in sources]
    return dijkstra(matrix, indices=rows, return_predecessors=True)[1]


def _path(before: Indices, source: int, sink: int) -> list[int]:
    """Roads from a source to a sink; empty if there is no path."""
    path = [sink]
    while path[-1] != source:
        path.append(int(before[path[-1]]))
        if path[-1] < 0:
            return []
    return path[::-1]
