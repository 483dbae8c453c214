"""openVO (Spevak, 2022): ORB matches between points of semi-global matching. MIT."""

from pydantic import Field

from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


class OpenVoSettings(Settings):
    """Settings of openVO; all others keep the values of its example."""

    seed: int = Field(default=0, ge=0, description="random seed of OpenCV")


class OpenVo(SubprocessEstimator):
    """Rigid motion between the points of the last two frames that could be aligned."""

    Settings = OpenVoSettings

    def __init__(self, rig: StereoRig, settings: OpenVoSettings) -> None:
        super().__init__("openvo", rig, settings.model_dump(mode="json"))
