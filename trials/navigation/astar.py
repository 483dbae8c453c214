"""A* (Hart, Nilsson and Raphael 1968) on any graph."""

from heapq import heappop, heappush
from itertools import count
from math import inf

from trials.navigation.graph import Graph, N, edge_cost


def astar(graph: Graph[N], start: N, goal: N) -> tuple[list[N], float]:
    """Find a cheapest path.

    Returns:
        The nodes from start to goal, and their cost; no nodes and infinity if there is no path.

    Raises:
        PlanningError: If a cost on the way is NaN, zero or negative.
    """
    g: dict[N, float] = {start: 0.0}
    parent: dict[N, N] = {}
    closed: set[N] = set()
    entry = count()  # decides between equals, so that nodes need no order
    # Of nodes that promise the same, the one farthest from the start goes first.
    queue = [(graph.heuristic(start, goal), 0.0, next(entry), start)]
    while queue:
        _, _, _, node = heappop(queue)
        if node == goal:
            return _trace(parent, goal), g[goal]
        if node in closed:
            continue
        closed.add(node)
        for successor in graph.successors(node):
            cost = g[node] + edge_cost(graph, node, successor)
            if cost < g.get(successor, inf):
                g[successor] = cost
                parent[successor] = node
                key = cost + graph.heuristic(successor, goal)
                heappush(queue, (key, -cost, next(entry), successor))
    return [], inf


def _trace(parent: dict[N, N], node: N) -> list[N]:
    path = [node]
    while node in parent:
        node = parent[node]
        path.append(node)
    return path[::-1]
