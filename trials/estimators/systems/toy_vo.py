"""toy-vo: a small stereo odometry in Rust after Basalt, through its wheel. GPL-2."""

from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.contract.rig import StereoRig


class ToyVo(SubprocessEstimator):
    """toy-vo with its default settings."""

    def __init__(self, rig: StereoRig) -> None:
        super().__init__("toy_vo", rig, {})
