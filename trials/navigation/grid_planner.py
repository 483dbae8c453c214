"""D* Lite on the cells of a grid."""

from collections.abc import Sequence

import numpy as np

from trials.navigation.dstar_lite import DStarLite
from trials.navigation.errors import PlanningError
from trials.navigation.grid import (
    Cell,
    cell_index,
    expect_costs,
    grid_cells,
    grid_shape,
    make_grid,
    neighbourhood,
)
from vo.contract.arrays import Array, Indices


class GridPlanner:
    """The cheapest path over a grid from a moving agent to a goal, kept up to date.

    Args:
        costs: (H, W), 1 for free ground, more for worse ground, infinite where closed; copied.
        start: Row and column of the agent.
        goal: Row and column.

    Raises:
        PlanningError: If a cost is below 1 or NaN, or an end is outside the grid.
    """

    def __init__(self, costs: Array, start: Cell, goal: Cell) -> None:
        self._grid = make_grid(costs)
        ends = cell_index(self._grid, start), cell_index(self._grid, goal)
        self._search = DStarLite(self._grid, len(self._grid.cells), *ends)

    @property
    def cost(self) -> float:
        """Cost of the path from start to goal, in cells; infinite if there is none."""
        return self._search.cost

    @property
    def expanded(self) -> int:
        """Cells expanded so far."""
        return self._search.expanded

    def move(self, start: Cell) -> None:
        """Note the cell of the agent.

        Raises:
            PlanningError: If it is outside the grid.
        """
        self._search.move(cell_index(self._grid, start))

    def replan(self, cells: Sequence[Cell] = (), costs: Sequence[float] = ()) -> None:
        """Change the costs of some cells and repair the path.

        Raises:
            PlanningError: If a cost is below 1 or NaN, or a cell is outside the grid; nothing
                changes then.
        """
        if len(cells) != len(costs):
            raise PlanningError(f"replan: {len(cells)} cells with {len(costs)} costs")
        if len(cells):
            expect_costs(np.array([costs]))
        nodes = [cell_index(self._grid, cell) for cell in cells]
        self._change(np.array(nodes, dtype=np.int64), np.array(costs, dtype=float))

    def update(self, costs: Array) -> None:
        """Change to other (H, W) costs and repair the path where they differ.

        Raises:
            PlanningError: If the shape differs, or a cost is below 1 or NaN; nothing changes then.
        """
        other, grid = make_grid(costs), self._grid
        if grid_shape(other) != grid_shape(grid):
            raise PlanningError(f"grid: expected shape {grid_shape(grid)}, got {np.shape(costs)}")
        nodes = np.flatnonzero(other.cells != grid.cells)
        self._change(nodes, other.cells[nodes])

    def path(self) -> list[Cell]:
        """List the cells from start to goal; empty if there is no path."""
        return grid_cells(self._grid, self._search.path())

    def _change(self, nodes: Indices, costs: Array) -> None:
        self._grid.cells[nodes] = costs
        self._search.replan(neighbourhood(self._grid, nodes))
