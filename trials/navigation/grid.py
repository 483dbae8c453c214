"""An 8-connected grid of costs: steps, their costs and the octile distance, compiled.

Planners number the cells of a grid that has a closed margin around it, so that no step needs to
ask for the border.
"""

from math import inf

import numpy as np

from trials.navigation.graph import PlanningError
from vo.contract.arrays import Array
from vo.contract.compilation import compiled

ROWS = np.array([0, 0, 1, -1, 1, 1, -1, -1])
COLUMNS = np.array([1, -1, 0, 0, 1, -1, 1, -1])
"""The eight steps, diagonals last."""
STRAIGHT = 4
SQRT2 = float(np.sqrt(2))

Cell = tuple[int, int]
"""Row and column."""


def checked(costs: Array) -> Array:
    """Copy (H, W) costs, 1 for free ground, more where it is worse, infinite where closed.

    Raises:
        PlanningError: If it is no such grid; a cost below 1 or NaN is named with its cell.
    """
    costs = np.array(costs, dtype=float)
    if costs.ndim != 2 or costs.size == 0:
        raise PlanningError(f"grid: expected (H, W) costs, got shape {costs.shape}")
    wrong = np.argwhere(~(costs >= 1))
    if len(wrong):
        row, column = wrong[0].tolist()
        raise PlanningError(f"cell ({row}, {column}): cost {costs[row, column]} is not 1 or more")
    return costs


def padded(costs: Array) -> Array:
    """Lay a closed margin of one cell around (H, W) costs."""
    return np.pad(costs, 1, constant_values=inf)


def number(cell: Cell, shape: tuple[int, ...]) -> int:
    """Number a cell of the (H, W) grid within its padded grid.

    Raises:
        PlanningError: If it lies outside.
    """
    row, column = int(cell[0]), int(cell[1])
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise PlanningError(f"cell ({row}, {column}): outside the grid of {shape[0]} x {shape[1]}")
    return (row + 1) * (shape[1] + 2) + column + 1


def cell_of(node: int, width: int) -> Cell:
    """Row and column in the grid of a node of its padded grid, `width` cells wide."""
    row, column = divmod(node, width)
    return row - 1, column - 1


@compiled()
def step_cost(cells: Array, width: int, node: int, step: int) -> float:
    """Cost of a step: its length in cells times the mean cost of both cells.

    A diagonal step between two cells of which one is closed is closed itself.

    Args:
        cells: (n,) costs of the padded grid.
        width: Of the padded grid.
        node: Where from.
        step: Index into ROWS and COLUMNS.
    """
    down, right = ROWS[step] * width, COLUMNS[step]
    mean = 0.5 * (cells[node] + cells[node + down + right])
    if step < STRAIGHT:
        return mean
    if cells[node + down] == inf or cells[node + right] == inf:
        return inf
    return SQRT2 * mean


@compiled()
def octile(width: int, a: int, b: int) -> float:
    """Cost between two nodes if all is free: an admissible and consistent heuristic."""
    rows, columns = abs(a // width - b // width), abs(a % width - b % width)
    return max(rows, columns) + (SQRT2 - 1) * min(rows, columns)
