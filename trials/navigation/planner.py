"""Path planner: the path to the goal through an occupancy grid, maintained by D* Lite."""

from dataclasses import dataclass
from time import process_time

import numpy as np

from trials.navigation.grid import Cell
from trials.navigation.grid_planner import GridPlanner
from trials.navigation.occupancy_grid import OccupancyGrid, driving_costs
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2
from vo.contract.arrays import Array

CLOSED_COST = 30.0
"""Cost of closed cells around the rover and the goal: the rover stands there, so it can leave."""


@dataclass
class PlanningEffort:
    """Effort of planning.

    Attributes:
        plans: Number of times that the path was planned or repaired.
        expanded: Cells that D* Lite expanded.
        cpu_s: Processor time, that for the costs of the cells included.
    """

    plans: int = 0
    expanded: int = 0
    cpu_s: float = 0.0


class PathPlanner:
    """Plans a path, and repairs it where the grid has changed.

    Attributes:
        path_m: (N, 2) the path; N is 0 where there is none.
        effort: Effort so far.
    """

    def __init__(self, settings: NavigatorSettings, unknown_cost: float, replanning: bool) -> None:
        """Start without a path; without replanning, it is planned once for a goal."""
        self.path_m: Array = np.zeros((0, 2))
        self.effort = PlanningEffort()
        self._settings, self._unknown_cost = settings, unknown_cost
        self._replanning = replanning
        self._search: GridPlanner | None = None
        self._goal_m = np.zeros(2)

    def plan(self, grid: OccupancyGrid, pose: Pose2, goal_m: Array) -> None:
        """Plan the path from a pose to the goal (2,), or repair it."""
        same_goal = self._search is not None and np.array_equal(goal_m, self._goal_m)
        if same_goal and not self._replanning:
            return
        begun_s = process_time()
        here, goal = grid.cell(pose.x_m, pose.y_m), grid.cell(float(goal_m[0]), float(goal_m[1]))
        costs, expanded = self._costs(grid, here, goal), 0
        if self._search is None or not same_goal:
            self._search, self._goal_m = GridPlanner(costs, here, goal), goal_m.copy()
        else:
            expanded = self._search.expanded
            self._search.move(here)
            self._search.update(costs)
        self.path_m = grid.centres_m(self._search.path())
        if len(self.path_m):
            self.path_m[-1] = goal_m
        self.effort.plans += 1
        self.effort.expanded += self._search.expanded - expanded
        self.effort.cpu_s += process_time() - begun_s

    def _costs(self, grid: OccupancyGrid, here: Cell, goal: Cell) -> Array:
        """(H, W) of every cell; neither end is closed."""
        s = self._settings
        costs = driving_costs(grid, s.radius_m, s.occupancy)
        costs += self._unknown_cost * (grid.log_odds == 0)
        for cell in (here, goal):
            around = grid.disk(cell, s.radius_m / s.cell_m)
            costs[around] = np.minimum(costs[around], CLOSED_COST)
        return costs
