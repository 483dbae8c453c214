"""Mapping of disparity images to an occupancy grid."""

from dataclasses import replace

import cv2
import numpy as np

from sim.world.rover import WHEEL_RADIUS_M
from trials.navigation.occupancy_grid import OccupancyGrid, depth_of, empty_grid, integrate_depth
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

SIMILAR_PX = 2
"""Largest difference of neighbouring disparities of one surface."""


class DepthMapper:
    """Integrates disparity images into a grid, on top of a floor plan.

    Attributes:
        floor_plan: Static obstacles; None if unknown.
    """

    def __init__(
        self,
        rig: StereoRig,
        period_s: float,
        settings: NavigatorSettings,
        floor_plan: OccupancyGrid | None,
    ) -> None:
        """Prepare for a rig as delivered; the floor plan has the cell size of `settings`."""
        self.floor_plan = floor_plan
        self._rig, self._period_s, self._settings = rig, period_s, settings

    def new_grid(self, pose: Pose2, goal_m: Array) -> OccupancyGrid:
        """Return the floor plan, or an unknown grid around start and goal (2,)."""
        if self.floor_plan is not None:
            return self.floor_plan
        border_m = self._settings.border_m
        ends_m = np.array([pose[:2], goal_m])
        low, high = ends_m.min(axis=0) - border_m, ends_m.max(axis=0) + border_m
        x_m, y_m = zip(low.tolist(), high.tolist(), strict=True)
        return empty_grid(x_m, y_m, self._settings.cell_m)

    def integrate(self, grid: OccupancyGrid, disparity_px: Array, pose: Pose2) -> OccupancyGrid:
        """Add a disparity image.

        Args:
            grid: The grid before.
            disparity_px: (h, w) of the left image, possibly smaller, in pixels of the full one; 0
                or NaN where unknown.
            pose: Estimated pose of the rover.
        """
        s = self._settings
        fixed = (16 * np.nan_to_num(disparity_px)).astype(np.int16)  # as OpenCV filters it
        cv2.filterSpeckles(fixed, 0, s.min_speckle_px, 16 * SIMILAR_PX)
        depth_m = depth_of(fixed / 16.0, self._rig)
        small = _scaled(self._rig, depth_m.shape[1])
        stride = max(1, round(s.occupancy.stride_px * small.width_px / self._rig.width_px))
        T_body_cam = self._rig.T_body_cam
        T_world_body = se3.exp(np.array([0, 0, 0, 0, 0, pose.yaw_rad]))
        T_world_body[:3, 3] = pose.x_m, pose.y_m, WHEEL_RADIUS_M
        updated = integrate_depth(
            grid,
            depth_m,
            small,
            T_world_body @ T_body_cam,
            float(T_body_cam[2, 3]) + WHEEL_RADIUS_M,
            self._period_s,
            s.occupancy.model_copy(update={"stride_px": stride}),
        )
        if self.floor_plan is None:
            return updated
        return replace(updated, log_odds=np.maximum(updated.log_odds, self.floor_plan.log_odds))


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
