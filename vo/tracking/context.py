"""What every stage works with, from the first frame to the last."""

from dataclasses import dataclass

import numpy as np

from vo.contract.rig import StereoRig
from vo.hooks import Hooks


@dataclass(frozen=True)
class Gear:
    """Handed to the stages; what they are to do with it is in the view's settings.

    Attributes:
        rig: Calibration of the pair.
        hooks: May replace what a stage found.
        rng: Draws RANSAC's samples.
    """

    rig: StereoRig
    hooks: Hooks
    rng: np.random.Generator
