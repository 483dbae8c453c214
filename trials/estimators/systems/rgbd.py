"""OpenCV's RGB-D odometry, on disparity that semi-global matching estimates; frame to frame.

Source: Steinbrücker, Sturm and Cremers, Real-Time Visual Odometry from Dense RGB-D Images, ICCV
Workshops 2011. It needs OpenCV 5, or a build with its contributed modules, that has cv2.Odometry.
"""

from typing import Any, ClassVar, Literal

import cv2
import numpy as np
from pydantic import Field

from trials.estimators.systems.environments import ForeignSystemError
from vo.config import StereoSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.contract.settings import Settings
from vo.stereo.dense import DenseStereo

DEPTH_UNITS = 5000.0
"""Depth units per metre: those of TUM RGB-D files, which OpenCV expects without documenting it."""
LEVELS = 4
"""Levels of the image pyramid."""


class RgbdSettings(Settings):
    """Settings of the odometry, tuned in its favour; all others keep the values of OpenCV."""

    renamed: ClassVar = {"farthest_m": "max_depth_m", "least_gradient": "min_gradient_grey"}

    method: Literal["rgb", "rgb_depth"] = Field(
        default="rgb", description="residuals: intensity, or intensity and depth"
    )
    max_depth_m: float = Field(default=4.0, gt=0, description="largest depth that is used")
    min_gradient_grey: float = Field(
        default=3.0, gt=0, description="smallest gradient of pixels that are used; OpenCV's is 10"
    )


class RgbdOdometry:
    """Dense alignment of each frame with the previous one."""

    Settings = RgbdSettings

    def __init__(self, rig: StereoRig, settings: RgbdSettings) -> None:
        if not hasattr(cv2, "Odometry"):
            raise ForeignSystemError(f"OpenCV {cv2.__version__} has no cv2.Odometry; 5 has it")
        self.rig = rig
        self._stereo = DenseStereo(StereoSettings(method="semi_global", downscale=1))
        chosen = cv2.OdometrySettings()
        chosen.setCameraMatrix(rig.K.astype(np.float32))
        chosen.setMaxDepth(settings.max_depth_m)
        gradients = np.full((LEVELS, 1), settings.min_gradient_grey, np.float32)
        chosen.setMinGradientMagnitudes(gradients)
        kinds = {"rgb": cv2.OdometryType_RGB, "rgb_depth": cv2.OdometryType_RGB_DEPTH}
        self._odometry = cv2.Odometry(kinds[settings.method], chosen, cv2.OdometryAlgoType_COMMON)
        self._before: Any = None  # the prepared frame
        self._T_odom_cam = np.eye(4)

    def track(self, frame: StereoFrame) -> Estimate:
        """Align with the previous frame; after a lost frame, the next one starts a new segment."""
        clock = Clock()
        with clock("stereo"):
            depth = self._depth(frame)
        with clock("alignment"):
            now = cv2.OdometryFrame(depth, frame.left)
            self._odometry.prepareFrame(now)
            before, self._before = self._before, now
            if before is None:
                return Estimate(
                    frame.timestamp_ns, Status.START, self._T_odom_cam, timings_ms=clock.ms
                )
            found, T_now_before = self._odometry.compute(before, now, np.eye(4))
        if not found or not np.isfinite(T_now_before).all():
            self._before = None
            return Estimate(
                frame.timestamp_ns, Status.LOST, None, "no alignment", timings_ms=clock.ms
            )
        self._T_odom_cam = self._T_odom_cam @ se3.inverse(np.asarray(T_now_before, dtype=float))
        return Estimate(frame.timestamp_ns, Status.TRACKED, self._T_odom_cam, timings_ms=clock.ms)

    def _depth(self, frame: StereoFrame) -> Array:
        """Estimate depth (H, W) float32 in DEPTH_UNITS; NaN where unknown."""
        disparity_px = self._stereo(frame.left, frame.right)
        depth_m = self.rig.f_px * self.rig.baseline_m / disparity_px
        return (DEPTH_UNITS * depth_m).astype(np.float32)
