"""What one stereo frame shows before its pose is known."""

from dataclasses import dataclass

from vo.config import OdometrySettings
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.sequence import StereoFrame
from vo.features import Features, detect
from vo.matching import describe
from vo.stereo import DenseStereo


@dataclass(frozen=True)
class View:
    """A frame with its features and depth.

    Attributes:
        frame: The pair.
        features: Of the left image.
        vectors: (N, P) appearance of the features.
        dense: Disparity map, NaN where unknown; of size zero where stereo is sparse.
    """

    frame: StereoFrame
    features: Features
    vectors: Array
    dense: Array


def look(
    frame: StereoFrame, dense_stereo: DenseStereo, settings: OdometrySettings, clock: Clock
) -> View:
    """Detect and describe features in the left image (thesis 3.2), and match the eyes (3.1)."""
    with clock("features"):
        features = detect(frame.left, settings.features)
        vectors = describe(frame.left, features.pixels, settings.matching.patch_px)
    with clock("stereo"):
        dense = dense_stereo(frame.left, frame.right)
    return View(frame, features, vectors, dense)
