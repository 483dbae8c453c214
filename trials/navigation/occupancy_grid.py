"""An occupancy grid from depth images: log odds (Moravec and Elfes 1985) that fade with time.

The grid lies in any level frame, z up, in which the camera's pose is estimated. The ground is not
taken from that frame, which drifts, but found in every image, about where the camera's height and
attitude put it.
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

ROVER_RADIUS_M = math.hypot(0.30, 0.17)
"""About the midpoint of the axle: the far corner of the rover's chassis."""
LEAST_GROUND_POINTS, STEEPEST = 100, 0.15
"""A ground plane from fewer points, or steeper against the expected one, is not believed."""
GROUND_BAND_M, GROUND_BAND_SLOPE = 0.05, 0.05
"""How far from the expected ground its points may lie: at the camera, and more with distance."""


class OccupancySettings(Settings):
    """What counts as an obstacle, and how fast it is believed and forgotten."""

    stride_px: int = Field(default=4, ge=1, description="of the pixels looked at")
    farthest_m: float = Field(default=6.0, gt=0, description="depths beyond are not used")
    lowest_m: float = Field(default=0.05, gt=0, description="lower things are driven over")
    highest_m: float = Field(default=0.9, gt=0, description="higher things are driven under")
    hit: float = Field(default=0.9, gt=0, description="log odds of a cell with an obstacle seen")
    miss: float = Field(default=0.4, gt=0, description="log odds of a cell seen to be free")
    most: float = Field(default=4.0, gt=0, description="log odds that are never exceeded")
    half_life_s: float = Field(default=60.0, gt=0, description="after which log odds have halved")
    occupied: float = Field(default=0.8, gt=0, description="log odds from which a cell is closed")
    margin_m: float = Field(default=0.3, gt=0, description="beyond the rover's radius, at a cost")
    margin_cost: float = Field(default=4.0, ge=0, description="of driving along an obstacle")


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
        """The cell that holds a point; it may lie outside the grid."""
        x0_m, y0_m = self.corner_xy_m
        row, column = (y_m - y0_m) / self.cell_m, (x_m - x0_m) / self.cell_m
        return math.floor(row + 0.5), math.floor(column + 0.5)

    def centres_m(self, cells: list[Cell]) -> Array:
        """(N, 2) x and y of the centres of N cells."""
        rows_columns = np.array(cells, dtype=float).reshape(-1, 2)
        return np.array(self.corner_xy_m) + self.cell_m * rows_columns[:, ::-1]

    def near(self, cell: Cell, cells: float) -> Array:
        """(H, W) whether a cell is within so many cells of one."""
        rows, columns = np.ogrid[: self.log_odds.shape[0], : self.log_odds.shape[1]]
        return (rows - cell[0]) ** 2 + (columns - cell[1]) ** 2 <= cells**2


def empty_grid(x_m: tuple[float, float], y_m: tuple[float, float], cell_m: float) -> OccupancyGrid:
    """Make a grid over two ranges, of which nothing is known."""
    width, height = (math.ceil((b - a) / cell_m) + 1 for a, b in (x_m, y_m))
    return OccupancyGrid(np.zeros((height, width)), (x_m[0], y_m[0]), cell_m)


def depth_of(disparity_px: Array, rig: StereoRig) -> Array:
    """Depth (H, W) in metres from disparity; NaN where that is not positive."""
    positive = disparity_px > 0
    d = np.asarray(disparity_px, dtype=float)
    return np.divide(rig.f_px * rig.baseline_m, d, out=np.full(d.shape, np.nan), where=positive)


def observe(
    grid: OccupancyGrid,
    depth_m: Array,
    rig: StereoRig,
    T_world_cam: Array,
    camera_height_m: float,
    elapsed_s: float,
    settings: OccupancySettings,
) -> OccupancyGrid:
    """Let the grid fade, then enter one depth image.

    Args:
        grid: As it was.
        depth_m: (H, W) along the optical axis; NaN or infinite where unknown.
        rig: Its left eye took the image.
        T_world_cam: (4, 4) camera in the grid's frame.
        camera_height_m: Above the ground it stands on.
        elapsed_s: Since the last image.
        settings: What counts as what.
    """
    step = settings.stride_px
    v, u = np.mgrid[0 : depth_m.shape[0] : step, 0 : depth_m.shape[1] : step]
    z = np.where(depth_m[v, u] < settings.farthest_m, depth_m[v, u], np.nan)
    points_cam = np.stack([(u - rig.cx_px) * z / rig.f_px, (v - rig.cy_px) * z / rig.f_px, z], -1)
    camera_m = T_world_cam[:3, 3]
    offsets_m = points_cam @ T_world_cam[:3, :3].T
    heights_m = offsets_m[..., 2] - _ground_m(offsets_m, -camera_height_m)
    above = heights_m > settings.lowest_m
    obstacle, ground = above & (heights_m < settings.highest_m), heights_m <= settings.lowest_m
    seen = np.zeros(grid.log_odds.shape, dtype=np.int8)
    at = (camera_m[:2] - np.array(grid.corner_xy_m)) / grid.cell_m
    _mark(seen, at, offsets_m[..., :2] / grid.cell_m, obstacle, ground)
    faded = grid.log_odds * 0.5 ** (elapsed_s / settings.half_life_s)
    change = np.array([0.0, -settings.miss, settings.hit])[seen]
    return replace(grid, log_odds=np.clip(faded + change, -settings.most, settings.most))


def clearance_m(grid: OccupancyGrid, settings: OccupancySettings) -> Array:
    """Distance (H, W) in metres from each cell's centre to the closest occupied one's."""
    free = (grid.log_odds < settings.occupied).astype(np.uint8)
    if free.all():
        return np.full(free.shape, inf)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return grid.cell_m * np.asarray(distance, dtype=float)


def driving_costs(grid: OccupancyGrid, radius_m: float, settings: OccupancySettings) -> Array:
    """Costs (H, W) for a planner: 1 in the open or unknown, infinite where the rover would touch.

    Args:
        grid: What is known.
        radius_m: Of the rover; obstacles grow by it.
        settings: The margin beyond, in which the cost falls to 1.
    """
    beyond_m = clearance_m(grid, settings) - radius_m
    near = np.clip(1 - beyond_m / settings.margin_m, 0, 1)
    return np.where(beyond_m <= 0, inf, 1 + settings.margin_cost * near)


def _ground_m(offsets_m: Array, expected_m: float) -> Array:
    """Height of the ground (h, w) against the camera, below or above each of the offsets.

    A plane through the points close to the expected ground, by least squares, thrice.
    """
    away_m = np.linalg.norm(offsets_m[..., :2], axis=-1)
    ground_m = np.full(away_m.shape, expected_m)
    band_m = GROUND_BAND_M + GROUND_BAND_SLOPE * away_m
    for _ in range(3):
        near: Mask = np.abs(offsets_m[..., 2] - ground_m) < band_m
        if near.sum() < LEAST_GROUND_POINTS:
            break
        x, y, z = offsets_m[near].T
        weights = 1 / (0.5 + away_m[near])  # far points are the less exact
        A = np.stack([np.ones_like(x), x, y], axis=1)
        plane = np.linalg.lstsq(A * weights[:, None], z * weights, rcond=None)[0]
        if np.hypot(plane[1], plane[2]) > STEEPEST:
            break
        ground_m = plane[0] + offsets_m[..., :2] @ plane[1:]
        band_m = 0.6 * band_m
    return ground_m


@compiled()
def _mark(seen: Array, at: Array, offsets: Array, obstacle: Mask, ground: Mask) -> None:
    """Mark cells as free (1) or occupied (2), in place; occupied wins.

    Within a column of the image, what lies between the closest ground and the closest obstacle,
    or else the farthest ground, is free. What the column does not show, close to the rover or
    behind an obstacle, stays as it is.
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
