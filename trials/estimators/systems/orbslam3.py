"""ORB-SLAM3 (Campos et al., T-RO 2021), stereo, through its wheel `pyorbslam3`. GPL-3.

It is not deterministic: take the median of several runs. Its loop closing cannot be switched off.
"""

from pathlib import Path

from pydantic import Field

from trials.estimators.systems.elsewhere import Elsewhere
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings


class OrbSlam3Settings(Settings):
    """What it cannot know, and the values of its own EuRoC example."""

    vocabulary: Path = Field(default=Path(), description="its ORBvoc.txt, or one like it")
    rate_hz: float = Field(default=15.0, gt=0, description="of the recording")
    features: int = Field(default=1200, ge=100)
    far_baselines: float = Field(default=35.0, gt=0, description="beyond, points are far")
    pace: float = Field(
        default=1.0, ge=0, description="times as fast as recorded, for its threads; 0 is no pace"
    )


class OrbSlam3(Elsewhere):
    """Live poses."""

    Settings = OrbSlam3Settings

    def __init__(self, rig: StereoRig, settings: OrbSlam3Settings) -> None:
        if not settings.vocabulary.is_file():
            raise SettingsError(
                f"setting vocabulary: no such file {settings.vocabulary}; orbslam3 needs one, "
                "--set vocabulary=FILE"
            )
        super().__init__("orbslam3", rig, settings.model_dump(mode="json"))
