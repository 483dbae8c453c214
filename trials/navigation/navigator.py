"""A navigator without learning: occupancy grid, D* Lite, dynamic window, and backing off.

Disparity is mapped to an occupancy grid in the frame of the estimated pose; D* Lite maintains the
path to the goal; the dynamic window follows it. Cameras see only ahead, so the rover turns once
before it leaves, unless it has a floor plan. Without progress it backs off, weakens the grid
around it and turns again.
"""

import math
from dataclasses import replace
from math import inf

import cv2
import numpy as np

from sim.world.rover import WHEEL_RADIUS_M
from trials.navigation.occupancy_grid import (
    OccupancyGrid,
    clearance_m,
    depth_of,
    empty_grid,
    integrate_depth,
)
from trials.navigation.planner import PathPlanner
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import (
    PIVOT_RAD,
    Pose2,
    SteeringSettings,
    Twist,
    dynamic_window,
    lookahead_point,
)
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

STEP_BACK_M = 0.25
"""Displacement for the check of the floor plan behind the rover; its tail exceeds its radius."""
STAND = Twist(0.0, 0.0)
SIMILAR_PX = 2
"""Largest difference of neighbouring disparities of one surface."""


class Navigator:
    """Drives to a goal by a call of `act` at every step.

    Attributes:
        grid: Occupancy grid; None before the first step.
        planner: Planner of the path.
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
        """Prepare for a rig as delivered and the limits of the rover.

        The floor plan holds static obstacles, with the cell size of `settings`; the rest is free.
        Without `replanning`, the path is planned once.
        """
        self.settings = s = settings or NavigatorSettings()
        self._rig, self._steering, self._replanning = rig, steering, replanning
        self._floor_plan = floor_plan
        self.planner = PathPlanner(s, 0.0 if floor_plan else s.unknown_cost, replanning)
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

    def act(self, disparity_px: Array, pose: Pose2, goal_m: Array) -> Twist:
        """Choose the next speeds on the way to a goal (2,) in the frame of the estimated pose.

        `disparity_px` is (h, w) of the left image, possibly smaller, in pixels of the full one;
        0 or NaN where unknown.
        """
        s, plan, period_s = self.settings, self._floor_plan, self._steering.period_s
        self._time_s += period_s
        grid = self.grid or plan or grid_around(pose, goal_m, s)
        grid = integrate_disparity(grid, disparity_px, self._rig, pose, period_s, s)
        if plan:
            grid = replace(grid, log_odds=np.maximum(grid.log_odds, plan.log_odds))
        self.grid = grid
        if math.dist(goal_m, pose[:2]) < s.arrival_radius_m:
            self._twist = STAND
            return self._twist
        if self._time_s >= self._plan_at_s:
            self.planner.plan(grid, pose, goal_m)
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
        s, path_m = self.settings, self.planner.path_m
        if len(path_m) == 0:
            return Twist(0.0, 0.5 * self._steering.turn_max_radps)  # observe all around
        if not self._replanning and self._is_blocked(grid, pose):
            self._progress_s = self._time_s  # it waits, it is not stuck
            return STAND
        target = lookahead_point(pose, path_m, s.lookahead_m)
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
        ahead = [lookahead_point(pose, self.planner.path_m, x) for x in distances_m]
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
        plan, back = self._floor_plan, Twist(-self.settings.back_off_speed_mps, 0.0)
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


def grid_around(pose: Pose2, goal_m: Array, settings: NavigatorSettings) -> OccupancyGrid:
    """Make an unknown grid around the start and a goal (2,)."""
    ends_m = np.array([pose[:2], goal_m])
    low, high = ends_m.min(axis=0) - settings.border_m, ends_m.max(axis=0) + settings.border_m
    x_m, y_m = zip(low.tolist(), high.tolist(), strict=True)
    return empty_grid(x_m, y_m, settings.cell_m)


def integrate_disparity(
    grid: OccupancyGrid,
    disparity_px: Array,
    rig: StereoRig,
    pose: Pose2,
    elapsed_s: float,
    settings: NavigatorSettings,
) -> OccupancyGrid:
    """Fade a grid and add a disparity image, taken at an estimated pose by a rig as delivered.

    The image is (h, w) of the left one, possibly smaller, in pixels of the full one; 0 or NaN
    where unknown.
    """
    fixed = (16 * np.nan_to_num(disparity_px)).astype(np.int16)  # as OpenCV filters it
    cv2.filterSpeckles(fixed, 0, settings.min_speckle_px, 16 * SIMILAR_PX)
    depth_m = depth_of(fixed / 16.0, rig)
    small = _scaled(rig, depth_m.shape[1])
    stride = max(1, round(settings.occupancy.stride_px * small.width_px / rig.width_px))
    T_world_body = se3.exp(np.array([0, 0, 0, 0, 0, pose.yaw_rad]))
    T_world_body[:3, 3] = pose.x_m, pose.y_m, WHEEL_RADIUS_M
    return integrate_depth(
        grid,
        depth_m,
        small,
        T_world_body @ rig.T_body_cam,
        float(rig.T_body_cam[2, 3]) + WHEEL_RADIUS_M,
        elapsed_s,
        settings.occupancy.model_copy(update={"stride_px": stride}),
    )


def _scaled(rig: StereoRig, width_px: int) -> StereoRig:
    """The rig of images of another width."""
    scale = width_px / rig.width_px
    return replace(
        rig,
        width_px=width_px,
        height_px=round(rig.height_px * scale),
        f_px=rig.f_px * scale,
        cx_px=(rig.cx_px + 0.5) * scale - 0.5,
        cy_px=(rig.cy_px + 0.5) * scale - 0.5,
    )
