"""toy-vo: a small stereo odometry in Rust after Basalt, through its wheel. GPL-2."""

from trials.estimators.systems.elsewhere import Elsewhere
from vo.contract.rig import StereoRig


class ToyVo(Elsewhere):
    """With its own defaults."""

    def __init__(self, rig: StereoRig) -> None:
        super().__init__("toy_vo", rig, {})
