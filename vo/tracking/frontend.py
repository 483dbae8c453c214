"""Frontend: adaptation to the image, features and dense disparity of a frame."""

from dataclasses import replace

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.detector import detect
from vo.features.image_quality import adapt_settings, measure_image_quality
from vo.hooks import Hooks
from vo.map.frame import View
from vo.patches.zncc import describe
from vo.stereo.dense import DenseStereo
from vo.tracking.hooked import replace_features


class Frontend:
    """Turns frames into views."""

    def __init__(self, rig: StereoRig, settings: OdometrySettings) -> None:
        self._rig, self._settings = rig, settings
        self._dense_stereo = DenseStereo(settings.stereo)

    def process(self, frame: StereoFrame, smoothing_px: float, hooks: Hooks, clock: Clock) -> View:
        """Detect and describe features (thesis 3.2) and, if stereo is dense, match the pair (3.1).

        After a noisy image, all images are smoothed: `smoothing_px` is that of the frame before.
        """
        s = self._settings
        # A view, or an image that is read-only, would need machine code of its own.
        left, right = (np.require(x, requirements=("C", "W")) for x in (frame.left, frame.right))
        frame = replace(frame, left=left, right=right)
        with clock("features"):
            quality = measure_image_quality(frame.left)
        if quality.noise > s.features.noise_threshold_grey:
            smoothing_px = s.features.smoothing_px
        low_snr = quality.texture_to_noise < s.low_snr.texture_to_noise
        defocus = 0 < s.defocus.softness < quality.softness
        view = self.extract(frame, adapt_settings(s, low_snr, defocus), smoothing_px, clock)
        return replace_features(hooks, view)

    def extract(
        self, frame: StereoFrame, settings: OdometrySettings, smoothing_px: float, clock: Clock
    ) -> View:
        """Detect features and match the pair by given settings, after smoothing."""
        if smoothing_px > 0:
            pair = frame.left, frame.right
            smoothed = (cv2.GaussianBlur(image, (0, 0), smoothing_px) for image in pair)
            left, right = (np.asarray(image, np.uint8) for image in smoothed)
            frame = replace(frame, left=left, right=right)
        with clock("features"):
            features = detect(frame.left, settings.features)
            descriptors = describe(frame.left, features, settings.matching.patch_px)
        with clock("stereo"):
            dense = self._dense_stereo(frame.left, frame.right)
        return View(frame, self._rig, features, descriptors, dense, settings, smoothing_px)
