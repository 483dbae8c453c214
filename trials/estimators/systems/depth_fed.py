"""Systems that align depth images, fed with depth from estimated disparity, never the true one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.config import StereoSettings
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.stereo.dense import DenseStereo


class DepthFedEstimator(SubprocessEstimator):
    """Worker that receives the left image and depth (H, W) float64, metres, NaN where unknown."""

    def __init__(self, system: str, rig: StereoRig, options: Mapping[str, Any]) -> None:
        super().__init__(system, rig, options)
        self._fb_px_m = rig.f_px * rig.baseline_m
        self._stereo = DenseStereo(StereoSettings(method="semi_global", downscale=1))

    def images(self, frame: StereoFrame, clock: Clock) -> tuple[Array, Array]:
        """Return the left image and its depth by semi-global matching."""
        with clock("stereo"):
            depth_m = self._fb_px_m / self._stereo(frame.left, frame.right)
        return frame.left, depth_m.astype(np.float64)
