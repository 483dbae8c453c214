"""D* Lite (Koenig and Likhachev 2002, optimised version), compiled.

It searches from the goal, so that what it knows stays valid while the agent moves; when costs
change, it repairs only what they alter on the way to the agent. Line numbers in curly brackets
are those of the paper's figure 4.
"""

from math import inf
from typing import NamedTuple

import numpy as np

from trials.navigation.graph import (
    Graph,
    heuristic,
    in_degree,
    out_degree,
    predecessor,
    successor,
)
from trials.navigation.heap import Heap, empty_heap, put, remove
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled

SLACK = 1 + 1e-9
"""Factor within which keys count as equal: rounding must not end the search too early."""


class _State(NamedTuple):
    """What the compiled search reads and writes.

    Attributes:
        g: (n,) cost to the goal, as far as known.
        rhs: (n,) the same by the successors' g.
        heap: Nodes of which g and rhs differ.
        ends: (3,) int64, start, goal, and the start for which the keys were computed.
        km: (1,) by how much the agent's moves may have lowered the heuristic.
        expanded: (1,) int64, nodes expanded so far.
    """

    g: Array
    rhs: Array
    heap: Heap
    ends: Indices
    km: Array
    expanded: Indices


class DStarLite:
    """The cheapest path from a moving agent to a goal, kept up to date.

    Args:
        graph: The edges and their costs, which may be changed in place.
        nodes: Number of nodes of the graph.
        start: Node of the agent.
        goal: Node where the path ends.
    """

    def __init__(self, graph: Graph, nodes: int, start: int, goal: int) -> None:
        self.graph = graph
        g, rhs = np.full(nodes, inf), np.full(nodes, inf)
        rhs[goal] = 0.0
        ends, expanded = np.array([start, goal, start]), np.zeros(1, dtype=np.int64)
        self._state = _State(g, rhs, empty_heap(nodes), ends, np.zeros(1), expanded)
        self.replan(np.array([goal]))

    @property
    def cost(self) -> float:
        """Cost of the path from start to goal; infinite if there is none."""
        return float(self._state.rhs[self._state.ends[0]])

    @property
    def expanded(self) -> int:
        """Nodes expanded so far."""
        return int(self._state.expanded[0])

    def move(self, start: int) -> None:
        """Note the node of the agent."""
        self._state.ends[0] = start

    def replan(self, changed: Indices) -> None:
        """Repair the path.

        Args:
            changed: (k,) int64, nodes of which outgoing edges changed their cost; may repeat.
        """
        _repair(self.graph, self._state, changed)

    def path(self) -> list[int]:
        """List the nodes from start to goal; empty if there is no path."""
        if self.cost == inf:
            return []
        start, goal, _ = self._state.ends.tolist()
        nodes = [start]
        while nodes[-1] != goal:
            nodes.append(int(_best(self.graph, self._state, nodes[-1])[1]))
        return nodes


@compiled()
def _key(graph: Graph, state: _State, node: int) -> tuple[float, float]:  # {1'}
    near = min(state.g[node], state.rhs[node])
    return near + heuristic(graph, state.ends[0], node) + state.km[0], near


@compiled()
def _update(graph: Graph, state: _State, node: int) -> None:  # {7'-9'}
    if state.g[node] != state.rhs[node]:
        first, second = _key(graph, state, node)
        put(state.heap, node, first, second)
    else:
        remove(state.heap, node)


@compiled()
def _best(graph: Graph, state: _State, node: int) -> tuple[float, int]:
    """Cost to the goal through the best successor, and that successor."""
    best, through = inf, node
    for k in range(out_degree(graph, node)):
        head, edge = successor(graph, node, k)
        if edge + state.g[head] < best:
            best, through = edge + state.g[head], head
    return best, through


@compiled()
def _look_ahead(graph: Graph, state: _State, node: int) -> None:
    if node != state.ends[1]:
        state.rhs[node] = _best(graph, state, node)[0]


@compiled()
def _repair(graph: Graph, state: _State, changed: Indices) -> None:
    state.km[0] += heuristic(graph, state.ends[2], state.ends[0])  # {38'}
    state.ends[2] = state.ends[0]
    for node in changed:  # {40'-45'}, all edges of a node at once
        _look_ahead(graph, state, node)
        _update(graph, state, node)
    _search(graph, state)


@compiled()
def _search(graph: Graph, state: _State) -> None:  # {10'-28'}
    g, rhs, heap, start, goal = state.g, state.rhs, state.heap, state.ends[0], state.ends[1]
    while heap.size[0] > 0:
        node = int(heap.nodes[0])
        old = heap.keys[node, 0], heap.keys[node, 1]
        if old[0] > _key(graph, state, start)[0] * SLACK and rhs[start] <= g[start]:
            return
        if old < _key(graph, state, node):  # {14'}: the agent has moved since
            _update(graph, state, node)
            continue
        state.expanded[0] += 1
        g_old = g[node]
        closer = g_old > rhs[node]
        g[node] = rhs[node] if closer else inf
        _update(graph, state, node)
        for k in range(in_degree(graph, node)):
            tail, edge = predecessor(graph, node, k)
            if tail == goal or edge == inf:
                continue
            if closer:  # {16'-20'}
                if edge + g[node] < rhs[tail]:
                    rhs[tail] = edge + g[node]
                    _update(graph, state, tail)
            elif rhs[tail] == edge + g_old:  # {21'-28'}
                _look_ahead(graph, state, tail)
                _update(graph, state, tail)
