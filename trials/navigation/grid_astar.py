"""A* (Hart, Nilsson and Raphael 1968) on a grid, compiled."""

from math import inf

import numpy as np

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
from vo.contract.arrays import Array
from vo.contract.compilation import compiled


def grid_astar(costs: Array, start: Cell, goal: Cell) -> tuple[list[Cell], float]:
    """Find a cheapest path.

    Args:
        costs: (H, W), 1 for free ground, more where it is worse, infinite where closed.
        start: Row and column.
        goal: Row and column.

    Returns:
        The cells from start to goal, and their cost in cells; none and infinity without a path.

    Raises:
        PlanningError: If a cost is below 1 or NaN, or an end lies outside.
    """
    costs = checked(costs)
    width = costs.shape[1] + 2
    source, target = number(start, costs.shape), number(goal, costs.shape)
    parents, cost = search(padded(costs).ravel(), width, source, target)
    if cost == inf:
        return [], inf
    path = [target]
    while path[-1] != source:
        path.append(int(parents[path[-1]]))
    return [cell_of(node, width) for node in reversed(path)], cost


def search(cells: Array, width: int, start: int, goal: int) -> tuple[Array, float]:
    """Find a cheapest path over the (n,) padded cells; returns (n,) parents, and its cost."""
    g = np.full(len(cells), inf)
    parents = np.full(len(cells), -1, dtype=np.int64)
    _search(cells, width, start, goal, g, parents, empty_heap(len(cells)))
    return parents, float(g[goal])


@compiled()
def _search(
    cells: Array, width: int, start: int, goal: int, g: Array, parents: Array, heap: Heap
) -> None:
    g[start] = 0.0
    put(heap, start, octile(width, start, goal), 0.0)
    while heap.size[0] > 0:
        node = int(heap.nodes[0])
        if node == goal:
            return
        remove(heap, node)
        for step in range(8):
            successor = node + int(ROWS[step]) * width + int(COLUMNS[step])
            cost = g[node] + step_cost(cells, width, node, step)
            if cost < g[successor]:
                g[successor] = cost
                parents[successor] = node
                # Of cells that promise the same, the one farthest from the start goes first.
                put(heap, successor, cost + octile(width, successor, goal), -cost)
