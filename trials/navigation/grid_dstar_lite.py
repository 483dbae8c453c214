"""D* Lite (Koenig and Likhachev 2002, optimised version) on a grid, compiled.

Line by line the algorithm of `dstar_lite`, about a hundred times as fast.
"""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from trials.navigation.dstar_lite import SLACK
from trials.navigation.graph import PlanningError
from trials.navigation.grid import (
    COLUMNS,
    ROWS,
    Cell,
    cell_of,
    checked,
    number,
    octile,
    padded,
    step_cost,
)
from trials.navigation.heap import Heap, empty_heap, put, remove
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled


class _State(NamedTuple):
    """What the compiled search reads and writes.

    Attributes:
        cells: (n,) costs of the padded grid.
        g: (n,) cost to the goal, as far as known.
        rhs: (n,) the same by the neighbours' g.
        heap: Nodes of which g and rhs differ.
        ends: (2,) int64, start and goal.
        km: (1,) by how much the agent's moves may have lowered the heuristic.
        expanded: (1,) int64, cells expanded so far.
    """

    cells: Array
    g: Array
    rhs: Array
    heap: Heap
    ends: Indices
    km: Array
    expanded: Indices


class GridDStarLite:
    """The cheapest path over a grid from a moving agent to a goal, kept up to date.

    Args:
        costs: (H, W), 1 for free ground, more where it is worse, infinite where closed; copied.
        start: Row and column of the agent.
        goal: Row and column.

    Raises:
        PlanningError: If a cost is below 1 or NaN, or an end lies outside.
    """

    def __init__(self, costs: Array, start: Cell, goal: Cell) -> None:
        costs = checked(costs)
        self.shape = costs.shape
        self._width = costs.shape[1] + 2
        ends = np.array([number(start, costs.shape), number(goal, costs.shape)])
        cells = padded(costs).ravel()
        g, rhs = np.full(len(cells), inf), np.full(len(cells), inf)
        rhs[ends[1]] = 0.0
        heap, counter = empty_heap(len(cells)), np.zeros(1, dtype=np.int64)
        self._state = _State(cells, g, rhs, heap, ends, np.zeros(1), counter)
        self._last = int(ends[0])
        _update(self._state, self._width, self._goal)
        _search(self._state, self._width)

    @property
    def cost(self) -> float:
        """Of the path from start to goal, in cells; infinite if there is none."""
        return float(self._state.rhs[self._start])

    @property
    def expanded(self) -> int:
        """Cells expanded so far."""
        return int(self._state.expanded[0])

    def move(self, start: Cell) -> None:
        """Note where the agent is now.

        Raises:
            PlanningError: If that is outside.
        """
        self._state.ends[0] = number(start, self.shape)

    def replan(self, cells: Sequence[Cell] = (), costs: Sequence[float] = ()) -> None:
        """Change the costs of some cells and repair the path.

        Raises:
            PlanningError: If a cost is below 1 or NaN, or a cell outside; nothing changes then.
        """
        if len(cells) != len(costs):
            raise PlanningError(f"replan: {len(cells)} cells with {len(costs)} costs")
        if len(cells):
            checked(np.array([costs]))
        nodes = [number(cell, self.shape) for cell in cells]
        self._change(np.array(nodes, dtype=np.int64), np.array(costs, dtype=float))

    def update(self, costs: Array) -> None:
        """Go over to other (H, W) costs and repair the path; only what differs is looked at.

        Raises:
            PlanningError: If the shape is another, or a cost below 1 or NaN; nothing changes then.
        """
        costs = checked(costs)
        if costs.shape != self.shape:
            raise PlanningError(f"grid: expected shape {self.shape}, got {costs.shape}")
        values = padded(costs).ravel()
        nodes = np.flatnonzero(values != self._state.cells)
        self._change(nodes, values[nodes])

    def path(self) -> list[Cell]:
        """List the cells from start to goal; none if there is no way."""
        if self.cost == inf:
            return []
        nodes = [self._start]
        while nodes[-1] != self._goal:
            nodes.append(int(_best(self._state, self._width, nodes[-1])[1]))
        return [cell_of(node, self._width) for node in nodes]

    @property
    def _start(self) -> int:
        return int(self._state.ends[0])

    @property
    def _goal(self) -> int:
        return int(self._state.ends[1])

    def _change(self, nodes: Indices, costs: Array) -> None:
        self._state.km[0] += octile(self._width, self._last, self._start)  # {38'}
        self._last = self._start
        self._state.cells[nodes] = costs
        _look_around(self._state, self._width, nodes)
        _search(self._state, self._width)


@compiled()
def _key(state: _State, width: int, node: int) -> tuple[float, float]:  # {1'}
    near = min(state.g[node], state.rhs[node])
    return near + octile(width, state.ends[0], node) + state.km[0], near


@compiled()
def _update(state: _State, width: int, node: int) -> None:  # {7'-9'}
    if state.g[node] != state.rhs[node]:
        first, second = _key(state, width, node)
        put(state.heap, node, first, second)
    else:
        remove(state.heap, node)


@compiled()
def _best(state: _State, width: int, node: int) -> tuple[float, int]:
    """Cost to the goal through the best neighbour, and that neighbour."""
    best, through = inf, node
    for step in range(8):
        successor = node + int(ROWS[step]) * width + int(COLUMNS[step])
        cost = step_cost(state.cells, width, node, step) + state.g[successor]
        if cost < best:
            best, through = cost, successor
    return best, through


@compiled()
def _look_ahead(state: _State, width: int, node: int) -> None:
    if node != state.ends[1] and state.cells[node] < inf:
        state.rhs[node] = _best(state, width, node)[0]
    elif node != state.ends[1]:
        state.rhs[node] = inf


@compiled()
def _look_around(state: _State, width: int, nodes: Indices) -> None:
    """Every edge that a cell bears on, diagonals past it too, lies among its neighbours and it."""
    for node in nodes:
        for row in range(-1, 2):
            for column in range(-1, 2):
                _look_ahead(state, width, node + row * width + column)
                _update(state, width, node + row * width + column)


@compiled()
def _search(state: _State, width: int) -> None:  # {10'-28'}
    g, rhs, heap, start, goal = state.g, state.rhs, state.heap, state.ends[0], state.ends[1]
    while heap.size[0] > 0:
        node = int(heap.nodes[0])
        old = heap.keys[node, 0], heap.keys[node, 1]
        if old[0] > _key(state, width, start)[0] * SLACK and rhs[start] <= g[start]:
            return
        if old < _key(state, width, node):  # {14'}: the agent has moved since
            _update(state, width, node)
            continue
        state.expanded[0] += 1
        g_old = g[node]
        closer = g_old > rhs[node]
        g[node] = rhs[node] if closer else inf
        _update(state, width, node)
        for step in range(8):
            source = node + int(ROWS[step]) * width + int(COLUMNS[step])
            edge = step_cost(state.cells, width, node, step)
            if source == goal or edge == inf:
                continue
            if closer:  # {16'-20'}
                if edge + g[node] < rhs[source]:
                    rhs[source] = edge + g[node]
                    _update(state, width, source)
            elif rhs[source] == edge + g_old:  # {21'-28'}
                _look_ahead(state, width, source)
                _update(state, width, source)
