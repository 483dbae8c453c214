"""A navigator without learning: occupancy grid, D* Lite, dynamic window, and backing off.

Disparity is mapped to an occupancy grid in the frame of the estimated pose; D* Lite maintains the
path to the goal; the dynamic window follows it. Cameras see only ahead, so the rover turns once
before it leaves, unless it has a floor plan. Without progress it backs off, weakens the grid
around it and turns again.
"""

import math
from dataclasses import replace
from math import inf

import numpy as np

from trials.navigation.depth_mapping import DepthMapper
from trials.navigation.occupancy_grid import OccupancyGrid, clearance_m
from trials.navigation.planner import PathPlanner, PlanningEffort
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import (
    PIVOT_RAD,
    Pose2,
    SteeringSettings,
    Twist,
    dynamic_window,
    lookahead_point,
)
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

STEP_BACK_M = 0.25
"""Displacement for the check of the floor plan behind the rover; its tail exceeds its radius."""
STAND = Twist(0.0, 0.0)


class Navigator:
    """Drives to a goal by a call of `act` at every step.

    Attributes:
        grid: Occupancy grid; None before the first step.
        back_offs: Number of times that the rover had to back off.
    """

    def __init__(
        self,
        rig: StereoRig,
        steering: SteeringSettings,
        settings: NavigatorSettings | None = None,
        floor_plan: OccupancyGrid | None = None,
        replanning: bool = True,
    ) -> None:
        """Prepare.

        Args:
            rig: Calibration as delivered.
            steering: Limits of the rover; `period_s` is the time between two steps.
            settings: Settings of the navigator.
            floor_plan: Static obstacles, with the cell size of `settings`; the rest is free.
            replanning: Repair the path; otherwise it is planned once.
        """
        self.settings = s = settings or NavigatorSettings()
        self._steering, self._replanning = steering, replanning
        self._mapper = DepthMapper(rig, steering.period_s, s, floor_plan)
        self._planner = PathPlanner(s, 0.0 if floor_plan else s.unknown_cost, replanning)
        self.back_offs = 0
        self.grid: OccupancyGrid | None = None
        self._progress_pose: Pose2 | None = None
        self._progress_s, self._back_off_until_s = 0.0, -inf
        self._time_s, self._plan_at_s = 0.0, 0.0
        self._twist = STAND
        self._yaw_rad: float | None = None
        self._turned_rad = 0.0
        # A time limit, since a rover whose wheels slip does not complete the turn.
        self._turn_s = 2 * math.radians(s.initial_turn_deg) / steering.turn_max_radps
        self._turn_until_s = self._turn_s

    @property
    def path_m(self) -> Array:
        """(N, 2) the path that is followed; N may be 0."""
        return self._planner.path_m

    @property
    def effort(self) -> PlanningEffort:
        """Effort of planning so far."""
        return self._planner.effort

    def act(self, disparity_px: Array, pose: Pose2, goal_m: Array) -> Twist:
        """Choose the next speeds.

        Args:
            disparity_px: (h, w) of the left image, possibly smaller, in pixels of the full one; 0
                or NaN where unknown.
            pose: Estimated pose of the rover.
            goal_m: (2,) in the same frame.
        """
        s = self.settings
        self._time_s += self._steering.period_s
        grid = self.grid or self._mapper.new_grid(pose, goal_m)
        grid = self.grid = self._mapper.integrate(grid, disparity_px, pose)
        if math.dist(goal_m, pose[:2]) < s.arrival_radius_m:
            self._twist = STAND
            return self._twist
        if self._time_s >= self._plan_at_s:
            self._planner.plan(grid, pose, goal_m)
            self._plan_at_s = self._time_s + s.replan_period_s
        self._twist = self._back_off(pose) or self._turn(pose) or self._follow(grid, pose)
        return self._twist

    def _turn(self, pose: Pose2) -> Twist | None:
        """Turn on the spot at the beginning and after backing off, to observe all around."""
        if self._yaw_rad is not None:
            self._turned_rad += math.remainder(pose.yaw_rad - self._yaw_rad, 2 * math.pi)
        self._yaw_rad = pose.yaw_rad
        wanted_rad = math.radians(self.settings.initial_turn_deg)
        if self._turned_rad >= wanted_rad or self._time_s >= self._turn_until_s:
            return None
        self._progress_s = self._time_s
        return Twist(0.0, self._steering.turn_max_radps)

    def _follow(self, grid: OccupancyGrid, pose: Pose2) -> Twist:
        """Head for a point of the path; turn on the spot where it is to the side."""
        s = self.settings
        if len(self.path_m) == 0:
            return Twist(0.0, 0.5 * self._steering.turn_max_radps)  # observe all around
        if not self._replanning and self._is_blocked(grid, pose):
            self._progress_s = self._time_s  # it waits, it is not stuck
            return STAND
        target = lookahead_point(pose, self.path_m, s.lookahead_m)
        bearing = math.atan2(target[1] - pose.y_m, target[0] - pose.x_m) - pose.yaw_rad
        bearing = math.remainder(bearing, 2 * math.pi)
        limit = self._steering.turn_max_radps
        pivot = Twist(0.0, float(np.clip(s.pivot_gain * bearing, -limit, limit)))
        if abs(bearing) > PIVOT_RAD:
            return pivot
        free_m = clearance_m(grid, s.occupancy) - s.radius_m
        free_m[grid.disk(grid.cell(pose.x_m, pose.y_m), 1.5)] = s.cell_m
        return dynamic_window(pose, self._twist, target, grid, free_m, self._steering) or pivot

    def _is_blocked(self, grid: OccupancyGrid, pose: Pose2) -> bool:
        """Whether an obstacle stands on the path, shortly ahead."""
        s = self.settings
        distances_m = np.arange(0.0, s.stop_distance_m, grid.cell_m)
        ahead = [lookahead_point(pose, self.path_m, x) for x in distances_m]
        rows, columns = np.transpose([grid.cell(float(x), float(y)) for x, y in ahead])
        return bool((clearance_m(grid, s.occupancy)[rows, columns] < s.radius_m / 2).any())

    def _back_off(self, pose: Pose2) -> Twist | None:
        """Back off after a while without progress, and weaken the grid around the rover."""
        s = self.settings
        if self._time_s < self._back_off_until_s:
            return self._backwards(pose)
        last = self._progress_pose
        if last is None or math.dist(pose[:2], last[:2]) > s.min_progress_m:
            self._progress_pose, self._progress_s = pose, self._time_s
        if self._time_s - self._progress_s < s.stuck_timeout_s:
            return None
        assert self.grid is not None
        grid = self.grid
        near = grid.disk(grid.cell(pose.x_m, pose.y_m), s.forget_radius_m / s.cell_m)
        self.grid = replace(grid, log_odds=np.where(near, s.forget_factor, 1.0) * grid.log_odds)
        self._turned_rad = 0.0
        self._turn_until_s = self._time_s + s.back_off_duration_s + self._turn_s
        self.back_offs += 1
        self._progress_s = self._back_off_until_s = self._time_s + s.back_off_duration_s
        return self._backwards(pose)

    def _backwards(self, pose: Pose2) -> Twist:
        """Drive backwards, unless the floor plan has no room for another step back."""
        plan, back = self._mapper.floor_plan, Twist(-self.settings.back_off_speed_mps, 0.0)
        if plan is None:
            return back
        x_m = pose.x_m - STEP_BACK_M * math.cos(pose.yaw_rad)
        y_m = pose.y_m - STEP_BACK_M * math.sin(pose.yaw_rad)
        row, column = plan.cell(x_m, y_m)
        height, width = plan.log_odds.shape
        if not (0 <= row < height and 0 <= column < width):
            return STAND
        free_m = clearance_m(plan, self.settings.occupancy)[row, column]
        return back if free_m > self.settings.radius_m else STAND
