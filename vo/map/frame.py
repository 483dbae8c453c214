"""What one stereo frame shows before its pose is known."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Image
from vo.contract.clock import Clock
from vo.contract.sequence import StereoFrame
from vo.features.detector import Features, detect
from vo.patches.zncc import describe
from vo.stereo.dense import DenseStereo


@dataclass(frozen=True)
class View:
    """A frame with its features and depth.

    Attributes:
        frame: The pair.
        features: Of the left image.
        vectors: (N, P) appearance of the features.
        dense: Disparity map, NaN where unknown; of size zero where stereo is sparse.
        settings: What this image is met with.
    """

    frame: StereoFrame
    features: Features
    vectors: Array
    dense: Array
    settings: OdometrySettings


def look(
    frame: StereoFrame,
    dense_stereo: DenseStereo,
    settings: OdometrySettings,
    clock: Clock,
    smoothing_px: float = 0.0,
) -> View:
    """Detect and describe features in the left image (thesis 3.2), and match the eyes (3.1).

    Args:
        frame: The pair.
        dense_stereo: Matches the eyes, if stereo is dense.
        settings: What the image is met with, in this stage and all that follow.
        clock: Times the stages.
        smoothing_px: Standard deviation of a Gaussian that both images go through first.
    """
    if smoothing_px > 0:
        frame = replace(
            frame,
            left=_smooth(frame.left, smoothing_px),
            right=_smooth(frame.right, smoothing_px),
        )
    with clock("features"):
        features = detect(frame.left, settings.features)
        vectors = describe(frame.left, features.pixels, settings.matching.patch_px)
    with clock("stereo"):
        dense = dense_stereo(frame.left, frame.right)
    return View(frame, features, vectors, dense, settings)


def _smooth(image: Image, sigma_px: float) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)
