"""A navigator that needs no learning: what it sees, where to go through it, and how to get out.

Disparity becomes an occupancy grid in the frame in which the rover believes to be; D* Lite keeps
the way to the goal; the dynamic window follows it. Cameras see ahead alone, so the rover turns
once before it leaves, unless it has a floor plan. Where nothing goes on, it backs off, doubts what
it saw and looks again.
"""

import math
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from trials.navigation.depth_mapping import Lookout
from trials.navigation.occupancy_grid import OccupancyGrid, clearance_m
from trials.navigation.planner import Effort, Planner
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import (
    PIVOT_RAD,
    Pose2,
    SteeringSettings,
    Twist,
    aim,
    dynamic_window,
)
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

BEHIND_M = 0.25
"""Where the rover's axle would be if it backed off: its tail reaches farther than its radius."""


@dataclass
class _Progress:
    """When the rover last came somewhere."""

    place: Pose2
    since_s: float
    backing_until_s: float = -inf


class Navigator:
    """Drives to a goal; `act` at every step.

    Attributes:
        grid: What is known; nothing before the first step.
        retreats: How often the rover had to back off.
    """

    def __init__(
        self,
        rig: StereoRig,
        steering: SteeringSettings,
        settings: NavigatorSettings | None = None,
        floor_plan: OccupancyGrid | None = None,
        replanning: bool = True,
    ) -> None:
        """Know the cameras and the rover's limits.

        Args:
            rig: As delivered.
            steering: Limits; `period_s` is the time between two steps.
            settings: How careful to be.
            floor_plan: What is occupied for good; the rest is open. Of the cells of `settings`.
            replanning: Repair the way by what is seen; else it is planned once.
        """
        self.settings = s = settings or NavigatorSettings()
        self._steering, self._replanning = steering, replanning
        self._lookout = Lookout(rig, steering.period_s, s, floor_plan)
        self._planner = Planner(s, 0.0 if floor_plan else s.unknown_cost, replanning)
        self.retreats = 0
        self.grid: OccupancyGrid | None = None
        self._progress: _Progress | None = None
        self._time_s, self._plan_at_s = 0.0, 0.0
        self._twist = Twist(0.0, 0.0)
        self._yaw_rad: float | None = None
        self._turned_rad = 0.0
        # A wheel that slips does not turn for ever.
        self._turn_s = 2 * math.radians(s.look_around_deg) / steering.turn_max_radps
        self._look_until_s = self._turn_s

    @property
    def way_m(self) -> Array:
        """(N, 2) the way that is followed; N may be 0."""
        return self._planner.way_m

    @property
    def effort(self) -> Effort:
        """What planning has cost."""
        return self._planner.effort

    def act(self, disparity_px: Array, pose: Pose2, goal_m: Array) -> Twist:
        """Choose the next speeds.

        Args:
            disparity_px: (h, w) of the left image, possibly smaller, in pixels of the full one; 0
                or NaN where unknown.
            pose: Where the rover believes to be.
            goal_m: (2,) in the same frame.
        """
        s = self.settings
        self._time_s += self._steering.period_s
        known = self.grid or self._lookout.new_grid(pose, goal_m)
        grid = self.grid = self._lookout.look(known, disparity_px, pose)
        if math.hypot(goal_m[0] - pose.x_m, goal_m[1] - pose.y_m) < s.arrived_m:
            self._twist = Twist(0.0, 0.0)
            return self._twist
        if self._time_s >= self._plan_at_s:
            self._planner.plan(grid, pose, goal_m)
            self._plan_at_s = self._time_s + s.replan_s
        self._twist = self._retreat(pose) or self._look_around(pose) or self._follow(grid, pose)
        return self._twist

    def _look_around(self, pose: Pose2) -> Twist | None:
        """Turn on the spot, to begin with and after backing off."""
        if self._yaw_rad is not None:
            self._turned_rad += math.remainder(pose.yaw_rad - self._yaw_rad, 2 * math.pi)
        self._yaw_rad = pose.yaw_rad
        wanted_rad = math.radians(self.settings.look_around_deg)
        if self._turned_rad >= wanted_rad or self._time_s >= self._look_until_s:
            return None
        if self._progress:
            self._progress.since_s = self._time_s
        return Twist(0.0, self._steering.turn_max_radps)

    def _follow(self, grid: OccupancyGrid, pose: Pose2) -> Twist:
        """Head for a point on the way, on the spot where it is to the side."""
        s = self.settings
        if len(self.way_m) == 0:
            return Twist(0.0, 0.5 * self._steering.turn_max_radps)  # look around
        if not self._replanning and self._closed_ahead(grid, pose):
            if self._progress:
                self._progress.since_s = self._time_s  # it waits, it is not stuck
            return Twist(0.0, 0.0)
        target = aim(pose, self.way_m, s.ahead_m)
        bearing = math.atan2(target[1] - pose.y_m, target[0] - pose.x_m) - pose.yaw_rad
        bearing = math.remainder(bearing, 2 * math.pi)
        most = self._steering.turn_max_radps
        pivot = Twist(0.0, float(np.clip(s.pivot_gain * bearing, -most, most)))
        if abs(bearing) > PIVOT_RAD:
            return pivot
        free_m = clearance_m(grid, s.occupancy) - s.radius_m
        free_m[grid.near(grid.cell(pose.x_m, pose.y_m), 1.5)] = s.cell_m
        return dynamic_window(pose, self._twist, target, grid, free_m, self._steering) or pivot

    def _closed_ahead(self, grid: OccupancyGrid, pose: Pose2) -> bool:
        """Whether something stands on the way, shortly ahead."""
        s = self.settings
        ahead = [aim(pose, self.way_m, x) for x in np.arange(0.0, s.stop_m, grid.cell_m)]
        rows, columns = np.transpose([grid.cell(float(x), float(y)) for x, y in ahead])
        return bool((clearance_m(grid, s.occupancy)[rows, columns] < s.radius_m / 2).any())

    def _retreat(self, pose: Pose2) -> Twist | None:
        """Back off where nothing has gone on for a while, and doubt what was seen there."""
        s = self.settings
        self._progress = progress = self._progress or _Progress(pose, self._time_s)
        if self._time_s < progress.backing_until_s:
            return Twist(-s.back_off_mps if self._open_behind(pose) else 0.0, 0.0)
        moved = math.hypot(pose.x_m - progress.place.x_m, pose.y_m - progress.place.y_m)
        if moved > s.progress_m:
            progress.place, progress.since_s = pose, self._time_s
        if self._time_s - progress.since_s < s.patience_s:
            return None
        assert self.grid is not None
        grid = self.grid
        near = grid.near(grid.cell(pose.x_m, pose.y_m), s.doubt_m / s.cell_m)
        self.grid = replace(grid, log_odds=np.where(near, s.doubt, 1.0) * grid.log_odds)
        self._turned_rad, self._look_until_s = 0.0, self._time_s + s.back_off_s + self._turn_s
        self.retreats += 1
        progress.since_s = progress.backing_until_s = self._time_s + s.back_off_s
        return Twist(-s.back_off_mps if self._open_behind(pose) else 0.0, 0.0)

    def _open_behind(self, pose: Pose2) -> bool:
        """Whether the floor plan has room for another step back; without one, nobody knows."""
        plan = self._lookout.floor_plan
        if plan is None:
            return True
        x_m, y_m = (
            a - BEHIND_M * b
            for a, b in zip(pose[:2], (math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)), strict=True)
        )
        row, column = plan.cell(x_m, y_m)
        height, width = plan.log_odds.shape
        free_m = clearance_m(plan, self.settings.occupancy)
        inside = 0 <= row < height and 0 <= column < width
        return bool(inside and free_m[row, column] > self.settings.radius_m)
