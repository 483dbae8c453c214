"""ORB-SLAM3 (Campos et al., T-RO 2021), stereo, through its wheel `pyorbslam3`. GPL-3.

Its results vary from run to run: take the median of several. Loop closing cannot be disabled.
"""

from pathlib import Path
from typing import ClassVar

from pydantic import Field

from trials.estimators.systems.environments import ForeignSystemError, systems_folder
from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


class OrbSlam3Settings(Settings):
    """Settings of ORB-SLAM3; defaults are those of its EuRoC example."""

    renamed: ClassVar = {"far_baselines": "far_point_baselines", "pace": "playback_rate"}

    vocabulary: Path | None = Field(
        default=None, description="vocabulary file; ORBvoc.txt in the folder of systems by default"
    )
    rate_hz: float = Field(default=15.0, gt=0, description="frame rate of the recording")
    features: int = Field(default=1200, ge=100, description="number of features in an image")
    far_point_baselines: float = Field(
        default=35.0, gt=0, description="depth in baselines beyond which points are far"
    )
    playback_rate: float = Field(
        default=1.0,
        ge=0,
        description="speed of frames over that of the recording, since threads map meanwhile; "
        "0 does not wait",
    )


class OrbSlam3(SubprocessEstimator):
    """Poses as they are estimated frame by frame."""

    Settings = OrbSlam3Settings

    def __init__(self, rig: StereoRig, settings: OrbSlam3Settings) -> None:
        file = settings.vocabulary or systems_folder() / "ORBvoc.txt"
        if settings.vocabulary and not file.is_file():
            raise SettingsError(f"setting vocabulary: no such file {file}")
        if not file.is_file():
            raise ForeignSystemError(
                f"orbslam3 needs its vocabulary: unpack Vocabulary/ORBvoc.txt.tar.gz of its "
                f"repository, UZ-SLAMLab/ORB_SLAM3, to {file}, or --set vocabulary=FILE"
            )
        super().__init__("orbslam3", rig, settings.model_dump() | {"vocabulary": str(file)})
