"""The lookout: what the cameras see becomes a grid of what is occupied."""

from dataclasses import replace

import cv2
import numpy as np

from sim.world.rover import WHEEL_RADIUS_M
from trials.navigation.occupancy_grid import OccupancyGrid, depth_of, empty_grid, observe
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

LIKE_PX = 2
"""Neighbouring disparities of one surface differ by less."""


class Lookout:
    """Enters what is seen into a grid, over what a floor plan knows.

    Attributes:
        floor_plan: What is occupied for good; none: nothing is known.
    """

    def __init__(
        self,
        rig: StereoRig,
        period_s: float,
        settings: NavigatorSettings,
        floor_plan: OccupancyGrid | None,
    ) -> None:
        """Know the cameras.

        Args:
            rig: As delivered.
            period_s: Between two looks.
            settings: What is believed, and how soon it is forgotten.
            floor_plan: Of the cells of `settings`.
        """
        self.floor_plan = floor_plan
        self._rig, self._period_s, self._settings = rig, period_s, settings

    def new_grid(self, pose: Pose2, goal_m: Array) -> OccupancyGrid:
        """The floor plan, or a grid without knowledge about start and goal (2,)."""
        if self.floor_plan is not None:
            return self.floor_plan
        around_m = self._settings.around_m
        x_m, y_m = (
            (min(a, b) - around_m, max(a, b) + around_m)
            for a, b in zip(pose[:2], goal_m.tolist(), strict=True)
        )
        return empty_grid(x_m, y_m, self._settings.cell_m)

    def look(self, grid: OccupancyGrid, disparity_px: Array, pose: Pose2) -> OccupancyGrid:
        """Enter what is seen from a pose.

        Args:
            grid: What was known.
            disparity_px: (h, w) of the left image, possibly smaller, in pixels of the full one; 0
                or NaN where unknown.
            pose: Where the rover believes to be.
        """
        s = self._settings
        depth_m = depth_of(_cleaned(disparity_px, s.speckle_px), self._rig)
        small = _shrunk(self._rig, depth_m.shape[1])
        stride = max(1, round(s.occupancy.stride_px * small.width_px / self._rig.width_px))
        T_body_cam = self._rig.T_body_cam
        turn = se3.exp(np.array([0, 0, 0, 0, 0, pose.yaw_rad]))
        T_world_body = se3.pose(turn[:3, :3], np.array([pose.x_m, pose.y_m, WHEEL_RADIUS_M]))
        seen = observe(
            grid,
            depth_m,
            small,
            T_world_body @ T_body_cam,
            float(T_body_cam[2, 3]) + WHEEL_RADIUS_M,
            self._period_s,
            s.occupancy.model_copy(update={"stride_px": stride}),
        )
        if self.floor_plan is None:
            return seen
        return replace(seen, log_odds=np.maximum(seen.log_odds, self.floor_plan.log_odds))


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
