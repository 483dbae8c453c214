"""Networks of roads or corridors, and the graph of their travel times.

Those of the study are generated, one with a single decision and a large one with many routes;
others come from JSON files (docs/routing.md).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import Delaunay

from trials.navigation import PlanningError
from trials.navigation.adjacency import Adjacency, adjacency
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError
from vo.contract.settings import Settings, validated

Road = tuple[int, int]
"""Indices of the node that a road leaves and of the node that it enters."""

KMH = 1 / 3.6
TOP_SPEED_MPS = 120 * KMH
SPACING_M, JITTER = 2000.0, 0.25
"""Spacing of the large network's nodes, and their jitter in spacings."""
MAX_ROAD_M = 1.9 * SPACING_M
WINDING = 1.25
"""Largest ratio of a road's length to the straight distance."""
ROAD_RATIO = 0.85
"""Ratio of possible roads that exist, besides those that connect all nodes."""

SMALL = {
    "start": (0.0, 0.0),
    "fork": (4.0, 0.0),
    "short 1": (8.0, 1.5),
    "short 2": (12.0, 1.5),
    "long 1": (8.0, -3.0),
    "long 2": (12.0, -3.0),
    "goal": (16.0, 0.0),
}
"""Nodes of the small network, km."""
SHORT_WAY, LONG_WAY = (0, 1, 2, 3, 6), (1, 4, 5, 6)
SMALL_CONGESTED: Road = (2, 3)
ROUNDING = 1 - 1e-6
"""Smallest ratio of a given length to the straight distance."""


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


def small_network() -> Network:
    """Make the network with one decision: two ways of three roads, one 1.5 km longer."""
    xy_m = 1000 * np.array(list(SMALL.values()))
    lengths_m: dict[Road, float] = {}
    for way in (SHORT_WAY, LONG_WAY):
        for a, b in pairwise(way):
            lengths_m[a, b] = lengths_m[b, a] = float(np.linalg.norm(xy_m[a] - xy_m[b]))
    return Network(tuple(SMALL), xy_m, lengths_m, TOP_SPEED_MPS, start=0, goal=len(SMALL) - 1)


def large_network(rng: np.random.Generator, side: int = 15) -> Network:
    """Make a network of side x side nodes: a jittered grid, triangulated, some roads left out."""
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    xy_m = SPACING_M * (grid + rng.uniform(-JITTER, JITTER, grid.shape))
    triangles = Delaunay(xy_m).simplices
    pairs = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)), axis=0)
    straight_m = np.linalg.norm(xy_m[pairs[:, 0]] - xy_m[pairs[:, 1]], axis=1)
    pairs, straight_m = pairs[straight_m < MAX_ROAD_M], straight_m[straight_m < MAX_ROAD_M]
    n = len(xy_m)
    tree = minimum_spanning_tree(coo_matrix((straight_m, pairs.T), shape=(n, n)))
    kept = set(zip(*(ends.tolist() for ends in tree.nonzero()), strict=True))
    lengths_m: dict[Road, float] = {}
    for (a, b), distance_m in zip(pairs.tolist(), straight_m.tolist(), strict=True):
        exists, length_m = rng.random() < ROAD_RATIO, distance_m * rng.uniform(1, WINDING)
        if exists or (a, b) in kept:
            lengths_m[a, b] = lengths_m[b, a] = length_m
    return Network(tuple(str(k) for k in range(n)), xy_m, lengths_m, TOP_SPEED_MPS)


class MapNode(Settings):
    """A node of the network."""

    name: Annotated[str, Field(min_length=1)]
    x_m: float
    y_m: float


class MapRoad(Settings):
    """A road between two nodes; without a length it is straight."""

    ends: tuple[str, str]
    length_m: Annotated[float, Field(gt=0)] | None = None
    one_way: bool = False


class MapFile(Settings):
    """Content of the file."""

    top_speed_kmh: Annotated[float, Field(gt=0)] = 120.0
    nodes: Annotated[list[MapNode], Field(min_length=2)]
    roads: Annotated[list[MapRoad], Field(min_length=1)]
    start: str | None = None
    goal: str | None = None


def read_map(path: Path) -> Network:
    """Read a network.

    Raises:
        PlanningError: If the file is unreadable or invalid; names it, and the key, node or road.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PlanningError(f"{path}: cannot be read ({error.strerror})") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise PlanningError(f"{path}: not valid JSON ({error})") from None
    if not isinstance(content, dict):
        raise PlanningError(f"{path}: expected an object with the keys nodes and roads")
    try:
        return _network(validated(MapFile, content))
    except DriftyardError as error:
        raise PlanningError(f"{path}: {error}") from None


def _network(content: MapFile) -> Network:
    index = {node.name: k for k, node in enumerate(content.nodes)}
    if len(index) < len(content.nodes):
        names = [node.name for node in content.nodes]
        raise PlanningError(f"two nodes named {next(x for x in names if names.count(x) > 1)}")
    xy_m = np.array([(node.x_m, node.y_m) for node in content.nodes])
    lengths_m: dict[Road, float] = {}
    for road in content.roads:
        a, b = (_index(index, name) for name in road.ends)
        label, length_m = f"road {' to '.join(road.ends)}", road.length_m
        straight_m = float(np.linalg.norm(xy_m[a] - xy_m[b]))
        if straight_m == 0:
            raise PlanningError(f"{label}: its ends are at the same place")
        if length_m is not None and length_m < straight_m * ROUNDING:
            raise PlanningError(
                f"{label}: length_m {length_m:g} is less than the straight {straight_m:.1f}"
            )
        for ends in ((a, b),) if road.one_way else ((a, b), (b, a)):
            if ends in lengths_m:
                raise PlanningError(f"{label}: is listed twice")
            lengths_m[ends] = max(length_m or 0.0, straight_m)
    start, goal = (None if x is None else _index(index, x) for x in (content.start, content.goal))
    if start is not None and start == goal:
        raise PlanningError(f"start and goal are both {content.start}")
    return Network(tuple(index), xy_m, lengths_m, content.top_speed_kmh * KMH, start, goal)


def _index(index: dict[str, int], name: str) -> int:
    if name not in index:
        raise PlanningError(f"no node named {name}; valid: {', '.join(index)}")
    return index[name]
