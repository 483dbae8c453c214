"""A wall of little texture and much shading, out of focus."""

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.band_pass import GAIN, GREY, band_pass
from vo.hooks import NO_HOOKS
from vo.stereo.sparse import measure_disparities
from vo.tracking.frontend import Frontend

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
DISPARITY_PX = 12.4


def pair_out_of_focus():
    """A wall whose texture deviates by 0.7 grey levels, in a light that falls off to one side."""
    rng = np.random.default_rng(5)
    texture = cv2.GaussianBlur(rng.standard_normal((280, 400)), (0, 0), 4.0)
    light = np.linspace(60, 100, 400) + 5 * np.sin(np.linspace(0, 12, 280))[:, None]
    wall = (light + 0.7 * texture / texture.std()).astype(np.float32)
    centres = ((179.5, 139.5), (179.5 + DISPARITY_PX, 139.5))
    pair = (cv2.getRectSubPix(wall, (320, 240), centre) for centre in centres)
    return StereoFrame(1, *(np.rint(x).astype(np.uint8) for x in pair))


def test_texture_behind_shading_has_disparities():
    frame = pair_out_of_focus()
    view = Frontend(RIG, OdometrySettings()).process(frame, 0.0, False, NO_HOOKS, Clock())
    found = measure_disparities(view.frame, view.dense, view.features, view.settings.stereo)
    error_px = found.values_px[found.known] - DISPARITY_PX
    assert found.known.sum() > 300
    assert np.median(np.abs(error_px)) < 0.05
    assert (np.abs(error_px) < 0.5).mean() > 0.95


def test_band_pass_stays_until_images_are_in_focus():
    """A little more contrast than the limit, after less: templates of one kind go on."""
    rng, frontend = np.random.default_rng(5), Frontend(RIG, OdometrySettings())

    def is_band_passed(sigma_px, was_band_passed):
        texture = cv2.GaussianBlur(rng.standard_normal((240, 320)), (0, 0), sigma_px)
        image = np.rint(100 + 10 * texture / texture.std()).clip(0, 255).astype(np.uint8)
        frame = StereoFrame(1, image, image)
        return frontend.process(frame, 0.0, was_band_passed, NO_HOOKS, Clock()).is_band_passed

    assert not is_band_passed(4.0, was_band_passed=False)
    assert is_band_passed(4.0, was_band_passed=True)
    assert not is_band_passed(1.0, was_band_passed=True)


def test_band_pass_keeps_texture_and_drops_shading():
    u = np.arange(320.0)
    texture = 3 * np.sin(2 * np.pi * u / 24)
    image = np.rint(60 + 0.4 * u + texture)[None].repeat(240, axis=0).astype(np.uint8)
    inside = band_pass(image)[120, 40:280].astype(float)
    assert abs(inside.mean() - GREY) < 2
    share = inside.std() / (GAIN * texture.std())
    assert 0.65 < share < 1
