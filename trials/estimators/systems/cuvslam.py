"""cuVSLAM of NVIDIA, stereo, through `dim-odom`. Apache-2.0.

Source: Korovko et al., cuVSLAM: CUDA accelerated visual odometry and mapping, 2025.
"""

from pydantic import Field

from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


class CuVslamSettings(Settings):
    """Settings of cuVSLAM; all others keep their default values."""

    use_gpu: bool = Field(default=False, description="compute on the GPU; it needs one of NVIDIA")


class CuVslam(SubprocessEstimator):
    """Odometry of cuVSLAM, without its loop closing."""

    Settings = CuVslamSettings

    def __init__(self, rig: StereoRig, settings: CuVslamSettings) -> None:
        super().__init__("cuvslam", rig, settings.model_dump(mode="json"))
