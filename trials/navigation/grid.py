"""An 8-connected grid of costs as a graph, with the octile distance as heuristic.

The cells are numbered with a closed margin around the grid, so that no step of a cell or of one of
its neighbours needs a border check.
"""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from trials.navigation import PlanningError
from vo.contract.arrays import Array, Indices

ROWS = np.array([0, 0, 1, -1, 1, 1, -1, -1])
COLUMNS = np.array([1, -1, 0, 0, 1, -1, 1, -1])
"""Rows and columns of the eight steps; the first STRAIGHT are straight, the others diagonal."""
STRAIGHT = 4
MARGIN = 2
"""Cells."""
SQRT2 = float(np.sqrt(2))

Cell = tuple[int, int]
"""Row and column."""


class Grid(NamedTuple):
    """Costs of the cells, with the margin.

    Attributes:
        cells: (n,) float64, 1 for free ground, more for worse ground, infinite where closed.
        width: Columns, margin included.
    """

    cells: Array
    width: int


def make_grid(costs: Array) -> Grid:
    """Lay the closed margin around a copy of (H, W) costs; raises as `expect_costs`."""
    costs = expect_costs(costs)
    return Grid(np.pad(costs, MARGIN, constant_values=inf).ravel(), costs.shape[1] + 2 * MARGIN)


def expect_costs(costs: Array) -> Array:
    """Copy (H, W) costs.

    Raises:
        PlanningError: If the shape is wrong, or a cost is below 1 or NaN; names the cell.
    """
    costs = np.array(costs, dtype=float)
    if costs.ndim != 2 or costs.size == 0:
        raise PlanningError(f"grid: expected (H, W) costs, got shape {costs.shape}")
    for row, column in np.argwhere(~(costs >= 1))[:1].tolist():
        raise PlanningError(f"cell ({row}, {column}): cost {costs[row, column]} is not 1 or more")
    return costs


def grid_shape(grid: Grid) -> tuple[int, int]:
    """Rows and columns of the grid, without the margin."""
    return len(grid.cells) // grid.width - 2 * MARGIN, grid.width - 2 * MARGIN


def cell_index(grid: Grid, cell: Cell) -> int:
    """Number a cell; raises a PlanningError if it is outside the grid."""
    height, width = grid_shape(grid)
    row, column = int(cell[0]), int(cell[1])
    if not (0 <= row < height and 0 <= column < width):
        raise PlanningError(f"cell ({row}, {column}): outside the grid of {height} x {width}")
    return (row + MARGIN) * grid.width + column + MARGIN


def grid_cells(grid: Grid, nodes: Sequence[int]) -> list[Cell]:
    """Rows and columns of numbered cells."""
    return [(node // grid.width - MARGIN, node % grid.width - MARGIN) for node in nodes]


def neighbourhood(grid: Grid, nodes: Indices) -> Indices:
    """(9 n,) numbers of n cells and their neighbours: an edge between them may have changed."""
    offsets = np.arange(-1, 2)[:, None] * grid.width + np.arange(-1, 2)
    return (nodes[:, None] + offsets.ravel()).ravel()


def degree(graph: Grid, node: int) -> int:
    """Count the steps from or to a cell; the border is closed by its costs."""
    return 8


def step(graph: Grid, node: int, k: int) -> tuple[int, float]:
    """Return the cell that a step enters, and its length in cells times the cells' mean cost.

    A step costs the same in either direction. A diagonal step between two cells of which one is
    closed is closed itself.
    """
    down, right = ROWS[k] * graph.width, COLUMNS[k]
    mean = 0.5 * (graph.cells[node] + graph.cells[node + down + right])
    if k < STRAIGHT:
        return node + down + right, mean
    if graph.cells[node + down] == inf or graph.cells[node + right] == inf:
        return node + down + right, inf
    return node + down + right, SQRT2 * mean


def octile(graph: Grid, a: int, b: int) -> float:
    """Compute the cost between two cells if all is free."""
    width = graph.width
    rows, columns = abs(a // width - b // width), abs(a % width - b % width)
    return max(rows, columns) + (SQRT2 - 1) * min(rows, columns)
