"""Texture over noise against images whose noise and texture are known."""

import cv2
import numpy as np
import pytest

from vo.config import THESIS, OdometrySettings
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.image_quality import adapt_settings, measure_image_quality
from vo.hooks import NO_HOOKS
from vo.tracking.frontend import Frontend

RNG = np.random.default_rng(4)


def _texture(deviation: float) -> np.ndarray:
    """Smooth random texture (480, 640) of a known standard deviation."""
    smooth = cv2.GaussianBlur(RNG.standard_normal((480, 640)), (0, 0), 4.0)
    return deviation * smooth / smooth.std()


@pytest.mark.parametrize("noise", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("texture", [6.0, 12.0, 20.0])
def test_quality_texture_to_noise_is_ratio_of_energies(noise: float, texture: float) -> None:
    levels = 128 + _texture(texture) + noise * RNG.standard_normal((480, 640))
    image = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    # Variance within a block misses what is slower than the block; the calmest blocks underrate
    # the noise a little.
    ratio = (texture / noise) ** 2
    found = measure_image_quality(image)
    assert 0.5 * ratio < found.texture_to_noise < 1.3 * ratio + 0.2
    assert found.noise == pytest.approx(noise, rel=0.15)


def test_quality_separates_texture_from_noise() -> None:
    flat = np.clip(128 + 5 * RNG.standard_normal((480, 640)), 0, 255).astype(np.uint8)
    assert (
        measure_image_quality(flat).texture_to_noise < 0.5
    )  # the calmest blocks underrate the noise a little
    clean = np.rint(128 + _texture(20.0)).astype(np.uint8)
    assert measure_image_quality(clean).texture_to_noise > 100
    assert measure_image_quality(np.zeros((10, 10), np.uint8)).texture_to_noise == np.inf


@pytest.mark.parametrize(("contrast", "noise"), [(12, 0.0), (12, 1.0), (3, 1.2)])
def test_quality_softness_tells_defocus_from_motion_blur(contrast, noise) -> None:
    def softness(sigma_u: float, sigma_v: float) -> float:
        levels = RNG.standard_normal((480, 640))
        blurred = cv2.GaussianBlur(levels, (0, 0), sigmaX=sigma_u, sigmaY=sigma_v)
        levels = 128 + contrast * blurred / blurred.std() + noise * RNG.standard_normal((480, 640))
        return measure_image_quality(np.clip(np.rint(levels), 0, 255).astype(np.uint8)).softness

    limit = OdometrySettings().defocus.softness
    # Of Gaussian texture the energy over a distance is 1 - exp(-distance² / 4 sigma²).
    next_, near, far = (1 - np.exp(-(x**2) / 4 / 4**2) for x in (1, 2, 4))
    expected = 1 + 3 / 4 * (far - near) / (near - next_)
    assert softness(4, 4) == pytest.approx(expected, rel=0.05)
    assert softness(4, 4) > limit > softness(1, 1)
    assert softness(8, 1) < limit
    assert softness(1, 8) < limit


def test_adapt_settings_widens_windows_and_nothing_else() -> None:
    usual = OdometrySettings()
    assert adapt_settings(usual, low_snr=False, defocus=False) == usual

    noisy = adapt_settings(usual, low_snr=True, defocus=False)
    assert (noisy.matching.align_px, noisy.stereo.align_px, noisy.stereo.patch_px) == (13, 13, 17)
    assert noisy.stereo.max_sigma_px == pytest.approx(0.6)
    assert noisy.features == usual.features

    defocused = adapt_settings(usual, low_snr=False, defocus=True)
    assert (defocused.matching.align_px, defocused.stereo.align_px, defocused.stereo.patch_px) == (
        25,
        25,
        17,
    )
    assert defocused.stereo.max_sigma_px == 2 * usual.stereo.max_sigma_px
    assert defocused.stereo.max_disagreement_px == 2 * usual.stereo.max_disagreement_px
    assert defocused.features.threshold == pytest.approx(0.15 * usual.features.threshold)

    smeared = adapt_settings(usual, low_snr=False, defocus=False, smeared=True)
    assert (smeared.matching.align_px, smeared.stereo.align_px, smeared.stereo.patch_px) == (
        19,
        19,
        17,
    )
    assert smeared.features == usual.features

    both = adapt_settings(usual, low_snr=True, defocus=True)
    assert both.features == defocused.features
    assert (both.matching.align_px, both.stereo.align_px, both.stereo.patch_px) == (31, 31, 31)
    assert both.stereo.max_sigma_px == pytest.approx(0.6)
    for settings in (noisy, defocused, both):
        assert (settings.motion, settings.refinement) == (usual.motion, usual.refinement)
    assert THESIS.low_snr.texture_to_noise == THESIS.defocus.softness == 0


def test_noise_of_the_right_image_counts() -> None:
    sharp = cv2.GaussianBlur(RNG.standard_normal((480, 640)), (0, 0), 1.2)
    left = 128 + 12 * sharp / sharp.std()
    right = np.clip(left + 8 * RNG.standard_normal(left.shape), 0, 255)
    pair = (np.rint(x).astype(np.uint8) for x in (left, right))
    rig = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
    frontend = Frontend(rig, usual := OdometrySettings())
    view = frontend.process(StereoFrame(1, *pair), 0.0, False, NO_HOOKS, Clock())
    assert view.smoothing_px == usual.features.smoothing_px
    assert view.settings.stereo == adapt_settings(usual, low_snr=True, defocus=False).stereo
