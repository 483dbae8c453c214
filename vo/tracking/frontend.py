"""Frontend: adaptation to the image, features and dense disparity of a frame."""

from dataclasses import replace
from functools import cache, partial

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Image
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.band_pass import MIN_TEXTURE_TO_NOISE, amplify_threshold, band_pass
from vo.features.detector import detect
from vo.features.image_quality import (
    SMEARED,
    adapt_settings,
    choose_smoothing,
    measure_image_quality,
    measure_noise,
)
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import Detection, View
from vo.patches.zncc import describe
from vo.stereo.dense import DenseStereo
from vo.tracking.diagnostics import is_faint
from vo.tracking.hooked import replace_features

STAYS_SOFT = 0.9
"""Factor on the softness below which images that follow a band-pass are in focus again."""

FAINT_GAIN = 8.0
"""Factor on the grey levels of faint images after smoothing, which finds differences of less than a
level that noise has dithered."""


class Frontend:
    """Turns frames into views."""

    def __init__(self, rig: StereoRig, settings: OdometrySettings) -> None:
        self._rig, self._settings = rig, settings
        self._dense_stereo = DenseStereo(settings.stereo)
        self._adapt = cache(partial(adapt_settings, settings))  # most images demand the same

    def process(
        self, frame: StereoFrame, smoothing_px: float, was_band_passed: bool, hooks: Hooks,
        clock: Clock,
    ) -> View:  # fmt: skip
        """Prepare the detection of features (thesis 3.2); match the pair if stereo is dense (3.1).

        `smoothing_px` is that of the frame before (`choose_smoothing`).
        After a band-pass, all are replaced by theirs until they are in focus: templates of one kind
        do not match the other.
        """
        s = self._settings
        # A view, or an image that is read-only, would need machine code of its own.
        left, right = (np.require(x, requirements=("C", "W")) for x in (frame.left, frame.right))
        frame = replace(frame, left=left, right=right)
        with clock("features"):
            quality = measure_image_quality(frame.left)
            right_noise, right_texture_to_noise = measure_noise(frame.right)
        noise = max(quality.noise, right_noise)
        texture_to_noise = min(quality.texture_to_noise, right_texture_to_noise)
        faint = is_faint(left)
        smoothing_px = choose_smoothing(noise, texture_to_noise, faint, smoothing_px, s)
        low_snr = texture_to_noise < s.low_snr.texture_to_noise
        limit = s.defocus.softness * (STAYS_SOFT if was_band_passed else 1)
        defocus = 0 < limit < quality.softness
        smeared = s.defocus.softness > 0 and quality.smear > SMEARED and not defocus
        very_low_snr = smoothing_px > s.features.smoothing_px and not defocus
        settings = self._adapt(low_snr, defocus, smeared, very_low_snr)
        is_poor = was_band_passed or texture_to_noise < MIN_TEXTURE_TO_NOISE
        if is_band_passed := defocus and is_poor:
            frame = replace(frame, left=band_pass(left), right=band_pass(right))
            smoothing_px, settings = 0.0, amplify_threshold(settings)
        gain = FAINT_GAIN if faint and very_low_snr else 1.0
        view = self.extract(frame, settings, smoothing_px, clock, hooks, gain)
        return replace(
            view, is_smeared=smeared, is_band_passed=is_band_passed, is_faint=faint,
            very_low_snr=very_low_snr,
        )  # fmt: skip

    def extract(
        self, frame: StereoFrame, settings: OdometrySettings, smoothing_px: float, clock: Clock,
        hooks: Hooks = NO_HOOKS, gain: float = 1.0,
    ) -> View:  # fmt: skip
        """Smooth the pair, and match it if stereo is dense; features are detected on demand."""
        if smoothing_px > 0:
            left, right = (_smooth(x, smoothing_px, gain) for x in (frame.left, frame.right))
        else:  # a camera may write its next image where this one is
            left, right = frame.left.copy(), frame.right.copy()
        frame = replace(frame, left=left, right=right)
        with clock("stereo"):
            dense = self._dense_stereo(frame.left, frame.right)

        def detect_features() -> tuple[Array, Array]:
            with clock("features"):
                pixels = replace_features(hooks, frame, detect(frame.left, settings.features))
                return pixels, describe(frame.left, pixels, settings.matching.patch_px)

        detection = Detection(detect_features)
        return View(frame, self._rig, detection, dense, settings, smoothing_px)


def _smooth(image: Image, sigma_px: float, gain: float) -> Image:
    """Smooth an image by a Gaussian, and amplify its differences from the mean by a gain."""
    if gain == 1:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)
    smoothed = cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma_px)
    amplified = gain * (smoothed - smoothed.mean()) + 128
    return np.clip(np.rint(amplified), 0, 255).astype(np.uint8)
