"""Band-pass of images that are out of focus: what texture is left, without slow shading.

Behind a blur of several pixels, shading has more contrast than texture, which is a few grey levels:
patches are alike by their ramps, and rounding is much of the rest. The difference of two Gaussians
takes out both, and is amplified before it is rounded again.
"""

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Image

FINE_PX, COARSE_PX = 1.0, 6.0
"""Standard deviations of the Gaussians."""

MIN_TEXTURE_TO_NOISE = 20.0
"""Energy of texture over that of noise below which an image out of focus needs its band-pass."""

GAIN = 6.0
"""Factor on the contrast."""

GREY = 128.0
"""Level of no contrast."""


def band_pass(image: Image) -> Image:
    """Return the amplified band-pass of an image (H, W)."""
    grey = image.astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (FINE_PX, COARSE_PX))
    return np.clip(np.rint(GREY + GAIN * (fine - coarse)), 0, 255).astype(np.uint8)


def amplify_threshold(settings: OdometrySettings) -> OdometrySettings:
    """Let the contrast that a feature needs be that before the band-pass."""
    features = settings.features
    features = features.model_copy(update={"threshold": GAIN * features.threshold})
    return settings.model_copy(update={"features": features})
