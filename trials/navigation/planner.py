"""D* Lite on the cells of a grid, and the path to the goal through an occupancy grid."""

from collections.abc import Sequence
from time import process_time

import numpy as np

from trials.navigation import PlanningError
from trials.navigation.dstar_lite import DStarLite
from trials.navigation.grid import (
    Cell,
    cell_index,
    expect_costs,
    grid_cells,
    grid_shape,
    make_grid,
    neighbourhood,
)
from trials.navigation.occupancy_grid import OccupancyGrid, driving_costs
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2
from vo.contract.arrays import Array, Indices

CLOSED_COST = 30.0
"""Cost of closed cells around the rover and the goal: the rover stands there, so it can leave."""


class GridPlanner:
    """The cheapest path over a grid from a moving agent to a goal, kept up to date by `search`.

    Costs (H, W) are 1 for free ground, more for worse ground, infinite where closed; copied.

    Raises:
        PlanningError: If a cost is below 1 or NaN, or an end is outside the grid.
    """

    def __init__(self, costs: Array, start: Cell, goal: Cell) -> None:
        self._grid = make_grid(costs)
        ends = cell_index(self._grid, start), cell_index(self._grid, goal)
        self.search = DStarLite(self._grid, len(self._grid.cells), *ends)

    def move(self, start: Cell) -> None:
        """Note the cell of the agent; raises a PlanningError if it is outside the grid."""
        self.search.move(cell_index(self._grid, start))

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
        return grid_cells(self._grid, self.search.path())

    def _change(self, nodes: Indices, costs: Array) -> None:
        self._grid.cells[nodes] = costs
        self.search.replan(neighbourhood(self._grid, nodes))


class PathPlanner:
    """Plans a path, and repairs it where the grid has changed.

    Attributes:
        path_m: (N, 2) the path; N is 0 where there is none.
        plans: Number of times that it was planned or repaired.
        expanded: Cells that D* Lite expanded.
        cpu_s: Processor time, that for the costs of the cells included.
    """

    def __init__(self, settings: NavigatorSettings, unknown_cost: float, replanning: bool) -> None:
        """Start without a path; without replanning, it is planned once for a goal."""
        self.path_m: Array = np.zeros((0, 2))
        self.plans, self.expanded, self.cpu_s = 0, 0, 0.0
        self._settings, self._unknown_cost = settings, unknown_cost
        self._replanning = replanning
        self._planner: GridPlanner | None = None
        self._goal_m = np.zeros(2)

    def plan(self, grid: OccupancyGrid, pose: Pose2, goal_m: Array) -> None:
        """Plan the path from a pose to the goal (2,), or repair it."""
        same_goal = self._planner is not None and np.array_equal(goal_m, self._goal_m)
        if same_goal and not self._replanning:
            return
        begun_s = process_time()
        here, goal = grid.cell(pose.x_m, pose.y_m), grid.cell(float(goal_m[0]), float(goal_m[1]))
        costs, expanded = self._costs(grid, here, goal), 0
        if self._planner is None or not same_goal:
            self._planner, self._goal_m = GridPlanner(costs, here, goal), goal_m.copy()
        else:
            expanded = self._planner.search.expanded
            self._planner.move(here)
            self._planner.update(costs)
        self.path_m = grid.centres_m(self._planner.path())
        if len(self.path_m):
            self.path_m[-1] = goal_m
        self.plans += 1
        self.expanded += self._planner.search.expanded - expanded
        self.cpu_s += process_time() - begun_s

    def _costs(self, grid: OccupancyGrid, here: Cell, goal: Cell) -> Array:
        """(H, W) of every cell; neither end is closed."""
        s = self._settings
        costs = driving_costs(grid, s.radius_m, s.occupancy)
        costs += self._unknown_cost * (grid.log_odds == 0)
        for cell in (here, goal):
            around = grid.disk(cell, s.radius_m / s.cell_m)
            costs[around] = np.minimum(costs[around], CLOSED_COST)
        return costs
