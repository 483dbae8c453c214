"""OpenCV's RGB-D odometry, on disparity that semi-global matching estimates; frame to frame.

Source: Steinbrücker, Sturm and Cremers, Real-Time Visual Odometry from Dense RGB-D Images, ICCV
Workshops 2011. It needs OpenCV 5, or a build with its contributed modules, that has cv2.Odometry.
"""

from typing import Any, Literal

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
"""In a metre. OpenCV takes depth as the TUM RGB-D files have it and does not say so."""


LEVELS = 4
"""Of its pyramid."""


class RgbdSettings(Settings):
    """Of the odometry; those not named keep OpenCV's values. Chosen in its favour."""

    method: Literal["rgb", "rgb_depth"] = "rgb"
    farthest_m: float = Field(default=4.0, gt=0, description="depth beyond is not used")
    least_gradient: float = Field(default=3.0, gt=0, description="of pixels used; OpenCV's is 10")


class RgbdOdometry:
    """Dense alignment of each frame with the one before."""

    Settings = RgbdSettings

    def __init__(self, rig: StereoRig, settings: RgbdSettings) -> None:
        if not hasattr(cv2, "Odometry"):
            raise ForeignSystemError(f"OpenCV {cv2.__version__} has no cv2.Odometry; 5 has it")
        self.rig = rig
        self._stereo = DenseStereo(StereoSettings(method="semi_global", downscale=1))
        chosen = cv2.OdometrySettings()
        chosen.setCameraMatrix(rig.K.astype(np.float32))
        chosen.setMaxDepth(settings.farthest_m)
        gradients = np.full((LEVELS, 1), settings.least_gradient, np.float32)
        chosen.setMinGradientMagnitudes(gradients)
        kinds = {"rgb": cv2.OdometryType_RGB, "rgb_depth": cv2.OdometryType_RGB_DEPTH}
        self._odometry = cv2.Odometry(kinds[settings.method], chosen, cv2.OdometryAlgoType_COMMON)
        self._before: Any = None  # the prepared frame
        self._T_odom_cam = np.eye(4)

    def track(self, frame: StereoFrame) -> Estimate:
        """Align with the frame before; a frame that cannot be is lost, and the next starts anew."""
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
        """Estimated depth (H, W) float32 in DEPTH_UNITS; NaN where unknown."""
        disparity_px = self._stereo(frame.left, frame.right)
        depth_m = self.rig.f_px * self.rig.baseline_m / disparity_px
        return (DEPTH_UNITS * depth_m).astype(np.float32)
