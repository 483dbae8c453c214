"""A navigator that needs no learning: what it sees, where to go through it, and how to get out.

Disparity becomes an occupancy grid in the frame in which the rover believes to be; D* Lite keeps
the way to the goal; the dynamic window follows it. Cameras see ahead alone, so the rover turns
once before it leaves, unless it has a floor plan. Where nothing goes on, it backs off, doubts what
it saw and looks again.
"""

import math
from dataclasses import dataclass, replace
from math import inf
from time import process_time

import cv2
import numpy as np
from pydantic import Field

from sim.rover import WHEEL_RADIUS_M
from trials.navigation.grid import Cell
from trials.navigation.grid_dstar_lite import GridDStarLite
from trials.navigation.occupancy import (
    OccupancyGrid,
    OccupancySettings,
    clearance_m,
    depth_of,
    driving_costs,
    empty_grid,
    observe,
)
from trials.navigation.steering import (
    PIVOT_RAD,
    Pose2,
    SteeringSettings,
    Twist,
    aim,
    dynamic_window,
)
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings

LIKE_PX = 2
"""Neighbouring disparities of one surface differ by less."""
CLOSED_BUT_HERE = 30.0
"""Cost of cells about the rover that seem to be closed: it stands there, so it can leave."""

BEHIND_M = 0.25
"""Where the rover's axle would be if it backed off: its tail reaches farther than its radius."""


class NavigatorSettings(Settings):
    """How careful the navigator is."""

    occupancy: OccupancySettings = OccupancySettings(
        farthest_m=3.5, hit=0.5, occupied=1.2, half_life_s=30.0
    )
    """An obstacle must be seen three times, and not from afar: block matching sees many that are
    not there, and a smear of distant ones closes an aisle until it is forgotten."""
    speckle_px: int = Field(default=60, ge=0, description="of alike disparities, fewer are wrong")
    radius_m: float = Field(default=0.35, gt=0, description="of the rover, about its axle")
    cell_m: float = Field(default=0.1, gt=0, description="of the grid")
    around_m: float = Field(default=8.0, gt=0, description="of the grid, beyond start and goal")
    look_around_deg: float = Field(
        default=360.0, ge=0, le=720, description="turn before leaving: cameras see ahead alone"
    )
    replan_s: float = Field(default=0.2, gt=0, description="between two looks at the way")
    ahead_m: float = Field(default=0.7, gt=0, description="along the way to what is headed for")
    stop_m: float = Field(default=1.0, gt=0, description="before what blocks a way that stays")
    arrived_m: float = Field(default=0.08, gt=0, description="from the goal, to stop")
    progress_m: float = Field(default=0.1, gt=0, description="that counts as such")
    patience_s: float = Field(default=7.0, gt=0, description="without progress, to back off")
    back_off_s: float = Field(default=1.5, gt=0)
    back_off_mps: float = Field(default=0.15, gt=0)
    doubt_m: float = Field(default=1.0, gt=0, description="about the rover, on backing off")
    doubt: float = Field(default=0.5, ge=0, le=1, description="what is left there of log odds")
    unknown_cost: float = Field(default=1.0, ge=0, description="more, where nothing was seen")
    pivot_gain: float = Field(default=1.5, gt=0, description="turning speed by angle")


@dataclass
class _Progress:
    """When the rover last came somewhere."""

    place: Pose2
    since_s: float
    backing_until_s: float = -inf


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


class Navigator:
    """Drives to a goal; `act` at every step.

    Attributes:
        grid: What is known.
        way_m: (N, 2) the way that is followed; N may be 0.
        retreats: How often the rover had to back off.
        effort: Of planning.
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
        self.settings = settings or NavigatorSettings()
        self._rig, self._steering = rig, steering
        self._floor_plan, self._replanning = floor_plan, replanning
        self.retreats = 0
        self.effort = Effort()
        self.grid: OccupancyGrid | None = floor_plan
        self.way_m: Array = np.zeros((0, 2))
        self._planner: GridDStarLite | None = None
        self._progress: _Progress | None = None
        self._time_s, self._plan_at_s = 0.0, 0.0
        self._twist = Twist(0.0, 0.0)
        self._goal_m = np.zeros(2)
        self._yaw_rad: float | None = None
        self._turned_rad = 0.0
        # A wheel that slips does not turn for ever.
        self._turn_s = 2 * math.radians(self.settings.look_around_deg) / steering.turn_max_radps
        self._look_until_s = self._turn_s

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
        grid = self.grid = self._look(disparity_px, pose, goal_m)
        if math.hypot(goal_m[0] - pose.x_m, goal_m[1] - pose.y_m) < s.arrived_m:
            self._twist = Twist(0.0, 0.0)
            return self._twist
        if self._time_s >= self._plan_at_s:
            self._plan(grid, pose, goal_m)
            self._plan_at_s = self._time_s + s.replan_s
        self._twist = self._retreat(pose) or self._look_around(pose) or self._follow(grid, pose)
        return self._twist

    def _look(self, disparity_px: Array, pose: Pose2, goal_m: Array) -> OccupancyGrid:
        """Enter what is seen into the grid; the first look lays it out."""
        s = self.settings
        if self.grid is None:
            x_m, y_m = (
                (min(a, b) - s.around_m, max(a, b) + s.around_m)
                for a, b in zip(pose[:2], goal_m.tolist(), strict=True)
            )
            self.grid = empty_grid(x_m, y_m, s.cell_m)
        depth_m = depth_of(_cleaned(disparity_px, s.speckle_px), self._rig)
        small = _shrunk(self._rig, depth_m.shape[1])
        stride = max(1, round(s.occupancy.stride_px * small.width_px / self._rig.width_px))
        T_body_cam = self._rig.T_body_cam
        turn = se3.exp(np.array([0, 0, 0, 0, 0, pose.yaw_rad]))
        T_world_body = se3.pose(turn[:3, :3], np.array([pose.x_m, pose.y_m, WHEEL_RADIUS_M]))
        seen = observe(
            self.grid,
            depth_m,
            small,
            T_world_body @ T_body_cam,
            float(T_body_cam[2, 3]) + WHEEL_RADIUS_M,
            self._steering.period_s,
            s.occupancy.model_copy(update={"stride_px": stride}),
        )
        if self._floor_plan is None:
            return seen
        return replace(seen, log_odds=np.maximum(seen.log_odds, self._floor_plan.log_odds))

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

    def _plan(self, grid: OccupancyGrid, pose: Pose2, goal_m: Array) -> None:
        """Plan the way to the goal, or repair it."""
        same_goal = self._planner is not None and np.array_equal(goal_m, self._goal_m)
        if same_goal and not self._replanning:
            return
        s, begun_s = self.settings, process_time()
        costs = driving_costs(grid, s.radius_m, s.occupancy)
        if self._floor_plan is None:
            costs += s.unknown_cost * (grid.log_odds == 0)
        here, goal = grid.cell(pose.x_m, pose.y_m), grid.cell(float(goal_m[0]), float(goal_m[1]))
        for cell in (here, goal):
            disc = _disc(costs.shape, cell, s.radius_m / s.cell_m)
            costs[disc] = np.minimum(costs[disc], CLOSED_BUT_HERE)
        expanded = 0
        if self._planner is None or not same_goal:
            self._planner, self._goal_m = GridDStarLite(costs, here, goal), goal_m.copy()
        else:
            expanded = self._planner.expanded
            self._planner.move(here)
            self._planner.update(costs)
        known = math.isfinite(self._planner.cost)
        cells: list[Cell] = self._planner.path() if known else []
        self.way_m = grid.centres_m(cells)
        if len(self.way_m):
            self.way_m[-1] = goal_m
        self.effort.plans += 1
        self.effort.expanded += self._planner.expanded - expanded
        self.effort.cpu_s += process_time() - begun_s

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
        free_m[_disc(free_m.shape, grid.cell(pose.x_m, pose.y_m), 1.5)] = s.cell_m
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
        disc = _disc(
            self.grid.log_odds.shape, self.grid.cell(pose.x_m, pose.y_m), s.doubt_m / s.cell_m
        )
        doubted = np.where(disc, s.doubt * self.grid.log_odds, self.grid.log_odds)
        self.grid = replace(self.grid, log_odds=doubted)
        self._turned_rad, self._look_until_s = 0.0, self._time_s + s.back_off_s + self._turn_s
        self.retreats += 1
        progress.since_s = progress.backing_until_s = self._time_s + s.back_off_s
        return Twist(-s.back_off_mps if self._open_behind(pose) else 0.0, 0.0)

    def _open_behind(self, pose: Pose2) -> bool:
        """Whether the floor plan has room for another step back; without one, nobody knows."""
        if self._floor_plan is None:
            return True
        x_m, y_m = (
            a - BEHIND_M * b
            for a, b in zip(pose[:2], (math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)), strict=True)
        )
        row, column = self._floor_plan.cell(x_m, y_m)
        height, width = self._floor_plan.log_odds.shape
        free_m = clearance_m(self._floor_plan, self.settings.occupancy)
        inside = 0 <= row < height and 0 <= column < width
        return bool(inside and free_m[row, column] > self.settings.radius_m)


def _cleaned(disparity_px: Array, speckle_px: int) -> Array:
    """Disparity (h, w) without islands; 0 where it is unknown."""
    fixed = (16 * np.nan_to_num(disparity_px)).astype(np.int16)
    cv2.filterSpeckles(fixed, 0, speckle_px, 16 * LIKE_PX)
    return fixed / 16.0


def _shrunk(rig: StereoRig, width_px: int) -> StereoRig:
    """The rig of images that are so wide."""
    scale = width_px / rig.width_px
    return replace(
        rig,
        width_px=width_px,
        height_px=round(rig.height_px * scale),
        f_px=rig.f_px * scale,
        cx_px=(rig.cx_px + 0.5) * scale - 0.5,
        cy_px=(rig.cy_px + 0.5) * scale - 0.5,
    )


def _disc(shape: tuple[int, ...], cell: Cell, radius: float) -> Array:
    """(H, W) which cells are within so many cells of one."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return (rows - cell[0]) ** 2 + (columns - cell[1]) ** 2 <= radius**2
