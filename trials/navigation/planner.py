"""The planner: the way to the goal through what is known, kept by D* Lite."""

import math
from dataclasses import dataclass
from time import process_time

import numpy as np

from trials.navigation.grid import Cell
from trials.navigation.grid_planner import GridPlanner
from trials.navigation.occupancy_grid import OccupancyGrid, driving_costs
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2
from vo.contract.arrays import Array

CLOSED_BUT_HERE = 30.0
"""Cost of cells about the rover that seem to be closed: it stands there, so it can leave."""


@dataclass
class Effort:
    """What planning has cost.

    Attributes:
        plans: How often the way was planned or repaired.
        expanded: Cells that D* Lite expanded.
        cpu_s: Processor time, that for the costs of the cells included.
    """

    plans: int = 0
    expanded: int = 0
    cpu_s: float = 0.0


class Planner:
    """Plans, and repairs its plan where the grid has changed.

    Attributes:
        way_m: (N, 2) the way; N is 0 where there is none.
        effort: So far.
    """

    def __init__(self, settings: NavigatorSettings, unknown_cost: float, replanning: bool) -> None:
        """Start without a way.

        Args:
            settings: How wide the rover is.
            unknown_cost: More for a cell where nothing was seen.
            replanning: Repair the way by what is seen; else it is planned once for a goal.
        """
        self.way_m: Array = np.zeros((0, 2))
        self.effort = Effort()
        self._settings, self._unknown_cost = settings, unknown_cost
        self._replanning = replanning
        self._search: GridPlanner | None = None
        self._goal_m = np.zeros(2)

    def plan(self, grid: OccupancyGrid, pose: Pose2, goal_m: Array) -> None:
        """Plan the way from a pose to the goal (2,), or repair it."""
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
        known = math.isfinite(self._search.cost)
        cells: list[Cell] = self._search.path() if known else []
        self.way_m = grid.centres_m(cells)
        if len(self.way_m):
            self.way_m[-1] = goal_m
        self.effort.plans += 1
        self.effort.expanded += self._search.expanded - expanded
        self.effort.cpu_s += process_time() - begun_s

    def _costs(self, grid: OccupancyGrid, here: Cell, goal: Cell) -> Array:
        """(H, W) of every cell; neither end is closed."""
        s = self._settings
        costs = driving_costs(grid, s.radius_m, s.occupancy)
        costs += self._unknown_cost * (grid.log_odds == 0)
        for cell in (here, goal):
            about = grid.near(cell, s.radius_m / s.cell_m)
            costs[about] = np.minimum(costs[about], CLOSED_BUT_HERE)
        return costs
