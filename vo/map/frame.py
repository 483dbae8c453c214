"""A stereo frame with its features and depth, before its pose is known."""

from dataclasses import dataclass

from vo.config import OdometrySettings
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame


@dataclass(frozen=True)
class View:
    """A frame with its features and depth.

    Attributes:
        frame: The pair.
        rig: Calibration of the pair.
        features: (N, 2) sub-pixel (u, v) in the left image, strongest first.
        descriptors: (N, P) of the features.
        dense: Disparity map, px, NaN where unknown; of size zero where stereo is sparse.
        settings: Adapted to the image, for all later stages.
        smoothing_px: Standard deviation of the Gaussian that the images were smoothed by; 0: none.
    """

    frame: StereoFrame
    rig: StereoRig
    features: Array
    descriptors: Array
    dense: Array
    settings: OdometrySettings
    smoothing_px: float = 0.0
