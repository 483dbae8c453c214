"""Networks of the study: one with a single decision, and a large one with many routes."""

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import Delaunay

from trials.routing.network import Network, Road

TOP_SPEED_MPS = 120 / 3.6
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
