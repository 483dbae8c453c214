"""An occupancy grid from depth images: log odds (Moravec and Elfes 1985) that fade with time.

The grid lies in a level frame, z up, in which the camera's pose is estimated. Since that frame
drifts, the ground is fitted in every image near where the camera's height and attitude predict it.
"""

import math
from dataclasses import dataclass, replace
from math import inf

import cv2
import numpy as np
from pydantic import Field

from trials.navigation.grid import Cell
from vo.contract.arrays import Array, Mask
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings

MIN_GROUND_POINTS, MAX_GROUND_SLOPE = 100, 0.15
"""A ground plane from fewer points, or steeper against the expected one, is rejected."""
GROUND_BAND_M, GROUND_BAND_SLOPE = 0.05, 0.05
"""Largest height of ground points over the expected ground, at the camera and for each metre."""


class OccupancySettings(Settings):
    """Settings of the occupancy grid."""

    stride_px: int = Field(default=4, ge=1)
    """Distance of the pixels that are used, px."""
    max_depth_m: float = Field(default=6.0, gt=0)
    """Largest depth that is used, m."""
    min_height_m: float = Field(default=0.05, gt=0)
    """Height that the rover drives over, m."""
    max_height_m: float = Field(default=0.9, gt=0)
    """Height that the rover drives under, m."""
    hit_log_odds: float = Field(default=0.9, gt=0)
    """Log odds added where an obstacle is observed."""
    miss_log_odds: float = Field(default=0.4, gt=0)
    """Log odds subtracted where free ground is observed."""
    max_log_odds: float = Field(default=4.0, gt=0)
    """Largest magnitude of the log odds."""
    half_life_s: float = Field(default=60.0, gt=0)
    """Time in which unobserved log odds halve, s."""
    occupied_log_odds: float = Field(default=0.8, gt=0)
    """Log odds from which on a cell is closed."""
    margin_m: float = Field(default=0.3, gt=0)
    """Width of the costly margin beyond the rover's radius, m."""
    margin_cost: float = Field(default=4.0, ge=0)
    """Additional cost at the inner edge of the margin."""


@dataclass(frozen=True)
class OccupancyGrid:
    """Cells of the ground, rows along y, columns along x.

    Attributes:
        log_odds: (H, W) float64 of being occupied; 0 is unknown.
        corner_xy_m: Centre of the cell (0, 0).
        cell_m: Side of a cell.
    """

    log_odds: Array
    corner_xy_m: tuple[float, float]
    cell_m: float

    def cell(self, x_m: float, y_m: float) -> Cell:
        """The cell of a point; it may be outside the grid."""
        x0_m, y0_m = self.corner_xy_m
        row, column = (y_m - y0_m) / self.cell_m, (x_m - x0_m) / self.cell_m
        return math.floor(row + 0.5), math.floor(column + 0.5)

    def centres_m(self, cells: list[Cell]) -> Array:
        """(N, 2) x and y of the centres of N cells."""
        rows_columns = np.array(cells, dtype=float).reshape(-1, 2)
        return np.array(self.corner_xy_m) + self.cell_m * rows_columns[:, ::-1]

    def disk(self, cell: Cell, radius_cells: float) -> Mask:
        """(H, W) whether a cell is within a radius, in cells, of one."""
        rows, columns = np.ogrid[: self.log_odds.shape[0], : self.log_odds.shape[1]]
        return (rows - cell[0]) ** 2 + (columns - cell[1]) ** 2 <= radius_cells**2


def empty_grid(x_m: tuple[float, float], y_m: tuple[float, float], cell_m: float) -> OccupancyGrid:
    """Make an unknown grid over two ranges."""
    width, height = (math.ceil((b - a) / cell_m) + 1 for a, b in (x_m, y_m))
    return OccupancyGrid(np.zeros((height, width)), (x_m[0], y_m[0]), cell_m)


def depth_of(disparity_px: Array, rig: StereoRig) -> Array:
    """Compute depth (H, W) in metres from disparity; NaN where that is not positive."""
    positive = disparity_px > 0
    d = np.asarray(disparity_px, dtype=float)
    return np.divide(rig.f_px * rig.baseline_m, d, out=np.full(d.shape, np.nan), where=positive)


def integrate_depth(
    grid: OccupancyGrid,
    depth_m: Array,
    rig: StereoRig,
    T_world_cam: Array,
    camera_height_m: float,
    elapsed_s: float,
    settings: OccupancySettings,
) -> OccupancyGrid:
    """Fade the grid by the time since the last image, then add one depth image.

    Depth (H, W) is along the optical axis, NaN or infinite where unknown; the rig is that image's
    calibration. T_world_cam (4, 4) is the camera in the grid's frame, its height that above the
    ground that the rover stands on.
    """
    step = settings.stride_px
    v, u = np.mgrid[0 : depth_m.shape[0] : step, 0 : depth_m.shape[1] : step]
    z = np.where(depth_m[v, u] < settings.max_depth_m, depth_m[v, u], np.nan)
    points_cam = np.stack([(u - rig.cx_px) * z / rig.f_px, (v - rig.cy_px) * z / rig.f_px, z], -1)
    camera_m = T_world_cam[:3, 3]
    offsets_m = points_cam @ T_world_cam[:3, :3].T
    heights_m = offsets_m[..., 2] - _ground_m(offsets_m, -camera_height_m)
    above = heights_m > settings.min_height_m
    obstacle = above & (heights_m < settings.max_height_m)
    ground = heights_m <= settings.min_height_m
    seen = np.zeros(grid.log_odds.shape, dtype=np.int8)
    at = (camera_m[:2] - np.array(grid.corner_xy_m)) / grid.cell_m
    _mark(seen, at, offsets_m[..., :2] / grid.cell_m, obstacle, ground)
    faded = grid.log_odds * 0.5 ** (elapsed_s / settings.half_life_s)
    change = np.array([0.0, -settings.miss_log_odds, settings.hit_log_odds])[seen]
    limit = settings.max_log_odds
    return replace(grid, log_odds=np.clip(faded + change, -limit, limit))


def clearance_m(grid: OccupancyGrid, settings: OccupancySettings) -> Array:
    """Compute the distance (H, W) in metres of each cell to the closest occupied one."""
    free = (grid.log_odds < settings.occupied_log_odds).astype(np.uint8)
    if free.all():
        return np.full(free.shape, inf)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return grid.cell_m * np.asarray(distance, dtype=float)


def driving_costs(grid: OccupancyGrid, radius_m: float, settings: OccupancySettings) -> Array:
    """Compute costs (H, W): infinite within the rover's radius of an obstacle, then falling to 1.

    Unknown cells count as free; the width of the margin in which the cost falls is a setting.
    """
    beyond_m = clearance_m(grid, settings) - radius_m
    near = np.clip(1 - beyond_m / settings.margin_m, 0, 1)
    return np.where(beyond_m <= 0, inf, 1 + settings.margin_cost * near)


def _ground_m(offsets_m: Array, expected_m: float) -> Array:
    """Height of the ground (h, w) relative to the camera, below or above each of the offsets.

    A plane is fitted three times to the points near the ground, in a narrowing band.
    """
    away_m = np.linalg.norm(offsets_m[..., :2], axis=-1)
    ground_m = np.full(away_m.shape, expected_m)
    band_m = GROUND_BAND_M + GROUND_BAND_SLOPE * away_m
    for _ in range(3):
        near: Mask = np.abs(offsets_m[..., 2] - ground_m) < band_m
        if near.sum() < MIN_GROUND_POINTS:
            break
        x, y, z = offsets_m[near].T
        weights = 1 / (0.5 + away_m[near])  # far points are less accurate
        A = np.stack([np.ones_like(x), x, y], axis=1)
        plane = np.linalg.lstsq(A * weights[:, None], z * weights, rcond=None)[0]
        if np.hypot(plane[1], plane[2]) > MAX_GROUND_SLOPE:
            break
        ground_m = plane[0] + offsets_m[..., :2] @ plane[1:]
        band_m = 0.6 * band_m
    return ground_m


@compiled()
def _mark(seen: Array, at: Array, offsets: Array, obstacle: Mask, ground: Mask) -> None:
    """Mark cells as free (1) or occupied (2), in place; occupied has priority.

    In a column of the image, the cells between the closest ground and the closest obstacle, or
    else the farthest ground, are free. Other cells of the column are left as they are.
    """
    height, width = seen.shape
    for k in range(offsets.shape[1]):
        close, far, stop = np.inf, 0.0, np.inf
        toward_x, toward_y = 0.0, 0.0
        for i in range(offsets.shape[0]):
            away = np.hypot(offsets[i, k, 0], offsets[i, k, 1])
            if ground[i, k]:
                close = min(close, away)
                if away > far:
                    far = away
                    toward_x, toward_y = offsets[i, k, 0] / away, offsets[i, k, 1] / away
            elif obstacle[i, k]:
                stop = min(stop, away)
                row = int(np.floor(at[1] + offsets[i, k, 1] + 0.5))
                column = int(np.floor(at[0] + offsets[i, k, 0] + 0.5))
                if 0 <= row < height and 0 <= column < width:
                    seen[row, column] = 2
        away = close
        while away <= min(far, stop):
            row = int(np.floor(at[1] + away * toward_y + 0.5))
            column = int(np.floor(at[0] + away * toward_x + 0.5))
            if 0 <= row < height and 0 <= column < width and seen[row, column] == 0:
                seen[row, column] = 1
            away += 0.5
