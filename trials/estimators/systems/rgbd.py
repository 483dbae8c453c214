"""OpenCV's RGB-D odometry, on disparity that semi-global matching estimates; frame to frame.

Source: Steinbrücker, Sturm and Cremers, Real-Time Visual Odometry from Dense RGB-D Images, ICCV
Workshops 2011. It needs OpenCV 5, or a build with its contributed modules, that has cv2.Odometry.
"""

from typing import ClassVar, Literal

from pydantic import Field

from trials.estimators.systems.depth_fed import DepthFedEstimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


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


class RgbdOdometry(DepthFedEstimator):
    """Dense alignment of each frame with the previous one; a lost one starts a new segment."""

    Settings = RgbdSettings

    def __init__(self, rig: StereoRig, settings: RgbdSettings) -> None:
        super().__init__("opencv_rgbd", rig, settings.model_dump(mode="json"))
