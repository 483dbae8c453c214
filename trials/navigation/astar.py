"""A* (Hart, Nilsson and Raphael 1968), compiled."""

from math import inf

import numpy as np

from trials.navigation.graph import Graph, heuristic, out_degree, successor
from trials.navigation.heap import Heap, empty_heap, put, remove
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled


def astar(graph: Graph, nodes: int, start: int, goal: int) -> tuple[Indices, float]:
    """Find a cheapest path in a graph of a number of nodes.

    Returns:
        (nodes,) the node before each on its cheapest path from the start, -1 at the start and where
        none was found, and the cost of the goal; infinite if there is no path.
    """
    g = np.full(nodes, inf)
    parents = np.full(nodes, -1, dtype=np.int64)
    _search(graph, start, goal, g, parents, empty_heap(nodes))
    return parents, float(g[goal])


@compiled()
def _search(graph: Graph, start: int, goal: int, g: Array, parents: Indices, heap: Heap) -> None:
    g[start] = 0.0
    put(heap, start, heuristic(graph, start, goal), 0.0)
    while heap.size[0] > 0:
        node = int(heap.nodes[0])
        if node == goal:
            return
        remove(heap, node)
        for k in range(out_degree(graph, node)):
            head, edge = successor(graph, node, k)
            cost = g[node] + edge
            if cost < g[head]:
                g[head] = cost
                parents[head] = node
                # Among equal keys, the node farthest from the start comes first.
                put(heap, head, cost + heuristic(graph, head, goal), -cost)
