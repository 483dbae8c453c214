"""A directed graph as adjacency lists, for networks of roads."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trials.navigation import PlanningError
from vo.contract.arrays import Array, Indices


class Adjacency(NamedTuple):
    """Edges by the node that they leave, and by the node that they enter.

    Attributes:
        costs: (m,) float64, may be changed in place; positive or infinite.
        tails: (m,) int64, node that each edge leaves.
        heads: (m,) int64, node that each edge enters.
        outgoing: (m,) int64, edges sorted by the node that they leave.
        first_out: (n + 1,) int64, first entry of each node in `outgoing`.
        incoming: (m,) int64, edges sorted by the node that they enter.
        first_in: (n + 1,) int64, first entry of each node in `incoming`.
        bounds: (n, n) float64, heuristic: consistent lower bounds of the costs between nodes.
    """

    costs: Array
    tails: Indices
    heads: Indices
    outgoing: Indices
    first_out: Indices
    incoming: Indices
    first_in: Indices
    bounds: Array


def adjacency(edges: Sequence[tuple[int, int]], costs: Array, bounds: Array) -> Adjacency:
    """Build the graph.

    Args:
        edges: m pairs: the node that an edge leaves, and the node that it enters.
        costs: (m,) positive or infinite; copied.
        bounds: (n, n) heuristic.

    Raises:
        PlanningError: If a cost is NaN, zero or negative; names the edge.
    """
    costs = np.array(costs, dtype=float)
    for k in np.flatnonzero(~(costs > 0))[:1].tolist():
        raise PlanningError(f"edge {edges[k][0]} to {edges[k][1]}: cost {costs[k]} is not positive")
    tails, heads = np.ascontiguousarray(np.array(edges, dtype=np.int64).reshape(-1, 2).T)
    outgoing, incoming = (np.argsort(ends, kind="stable") for ends in (tails, heads))
    nodes = np.arange(len(bounds) + 1)
    first_out = np.searchsorted(tails[outgoing], nodes)
    first_in = np.searchsorted(heads[incoming], nodes)
    return Adjacency(costs, tails, heads, outgoing, first_out, incoming, first_in, bounds)


def out_degree(graph: Adjacency, node: int) -> int:
    """Count the edges that leave a node."""
    return graph.first_out[node + 1] - graph.first_out[node]


def in_degree(graph: Adjacency, node: int) -> int:
    """Count the edges that enter a node."""
    return graph.first_in[node + 1] - graph.first_in[node]


def successor(graph: Adjacency, node: int, k: int) -> tuple[int, float]:
    """Return the node that the k-th outgoing edge enters, and the cost of the edge."""
    edge = graph.outgoing[graph.first_out[node] + k]
    return int(graph.heads[edge]), float(graph.costs[edge])


def predecessor(graph: Adjacency, node: int, k: int) -> tuple[int, float]:
    """Return the node that the k-th incoming edge leaves, and the cost of the edge."""
    edge = graph.incoming[graph.first_in[node] + k]
    return int(graph.tails[edge]), float(graph.costs[edge])


def bound(graph: Adjacency, a: int, b: int) -> float:
    """Look up the heuristic."""
    return graph.bounds[a, b]
