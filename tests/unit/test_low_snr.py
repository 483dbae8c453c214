"""A wall at dusk: texture buried in noise, or fainter than a grey level."""

import cv2
import numpy as np
import pytest

from vo.config import THESIS, OdometrySettings
from vo.contract.clock import Clock
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.image_quality import VERY_LOW_SNR, choose_smoothing
from vo.hooks import NO_HOOKS
from vo.odometry import StereoOdometry
from vo.stereo.sparse import measure_disparities
from vo.tracking.frontend import Frontend

RIG = StereoRig(480, 360, 345.0, 239.5, 179.5, 0.09)
DISPARITY_PX, STEP_PX = 12.4, 4.3


def pairs_at_dusk(count, mean, texture, noise):
    """Pairs before a wall that move to the right by STEP_PX each, with noise of their own."""
    rng = np.random.default_rng(3)
    wall = cv2.GaussianBlur(rng.standard_normal((420, 640)), (0, 0), 3.0)
    wall = (mean + texture * wall / wall.std()).astype(np.float32)

    def image(shift_px):
        grey = cv2.getRectSubPix(wall, (480, 360), (279.5 + shift_px, 209.5))
        grey = grey + noise * rng.standard_normal(grey.shape)
        return np.rint(grey).clip(0, 255).astype(np.uint8)

    for k in range(count):
        x = k * STEP_PX
        yield StereoFrame((k + 1) * 33_000_000, image(x), image(x + DISPARITY_PX))


def test_texture_buried_in_noise_is_tracked():
    odometry = StereoOdometry(RIG)
    found = [odometry.track(frame) for frame in pairs_at_dusk(6, 30, 5.0, 8.0)]
    assert [x.status for x in found].count(Status.LOST) == 0
    step_m = STEP_PX * RIG.baseline_m / DISPARITY_PX
    errors_m = [np.hypot(*(x.T_odom_cam[[0, 2], 3] - [k * step_m, 0])) for k, x in enumerate(found)]
    assert max(errors_m) < 0.01
    sigma_m = [np.sqrt(np.trace(x.step_covariance[:3, :3])) for x in found[1:]]
    assert np.all(np.abs(np.diff(errors_m)) < 4 * np.array(sigma_m))


def test_texture_below_a_grey_level_has_disparities():
    frame = next(pairs_at_dusk(1, 3, 0.8, 0.8))
    view = Frontend(RIG, OdometrySettings()).process(frame, 0.0, False, NO_HOOKS, Clock())
    found = measure_disparities(view.frame, view.dense, view.features, view.settings.stereo)
    error_px = found.values_px[found.known] - DISPARITY_PX
    assert view.is_faint
    assert found.known.sum() > 200
    assert np.median(np.abs(error_px)) < 0.3


@pytest.mark.parametrize(("noise", "faint"), [(6.0, False), (1.0, True)])
def test_smoothing_is_strong_until_the_snr_has_risen(noise, faint):
    usual = OdometrySettings()
    limit, usual_px = 0.5 * usual.low_snr.texture_to_noise, usual.features.smoothing_px
    strong_px = VERY_LOW_SNR.smoothing * usual_px
    assert choose_smoothing(noise, 0.9 * limit, faint, 0.0, usual) == strong_px
    assert choose_smoothing(noise, 1.1 * limit, faint, strong_px, usual) == strong_px
    assert choose_smoothing(noise, 1.4 * limit, faint, strong_px, usual) == usual_px
    assert choose_smoothing(1.0, 0.9 * limit, False, 0.0, usual) == 0  # plain, but without noise
    assert choose_smoothing(noise, 0.1, faint, 0.0, THESIS) == 0


def test_alike_images_share_their_settings():
    frontend = Frontend(RIG, OdometrySettings())
    views = [
        frontend.process(frame, 0.0, False, NO_HOOKS, Clock())
        for texture, noise in ((20.0, 0.0), (5.0, 8.0))
        for frame in pairs_at_dusk(2, 100, texture, noise)
    ]
    clear, noisy = views[:2], views[2:]
    assert clear[0].settings is clear[1].settings
    assert noisy[0].settings is noisy[1].settings
    assert noisy[0].settings.matching.min_zncc < clear[0].settings.matching.min_zncc
