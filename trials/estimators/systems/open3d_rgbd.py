"""Open3D's RGB-D odometry, on disparity that semi-global matching estimates; frame to frame. MIT.

Source: Park, Zhou and Koltun, Colored Point Cloud Registration Revisited, ICCV 2017; Open3D's
`rgbd_odometry_multi_scale`.
"""

from typing import Literal

from pydantic import Field

from trials.estimators.systems.depth_fed import DepthFedEstimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


class Open3dSettings(Settings):
    """Settings of the odometry; all others keep the values of Open3D."""

    method: Literal["hybrid", "intensity", "point_to_plane"] = Field(
        default="hybrid", description="residuals: intensity and depth, intensity, or depth"
    )
    max_depth_m: float = Field(default=4.0, gt=0, description="largest depth that is used")


class Open3dOdometry(DepthFedEstimator):
    """Dense alignment of each frame with the previous one; a lost one starts a new segment."""

    Settings = Open3dSettings

    def __init__(self, rig: StereoRig, settings: Open3dSettings) -> None:
        super().__init__("open3d_rgbd", rig, settings.model_dump(mode="json"))
