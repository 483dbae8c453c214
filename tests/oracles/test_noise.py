"""Texture over noise against images whose noise and texture are known."""

import cv2
import numpy as np
import pytest

from vo.config import THESIS, OdometrySettings
from vo.features.adaptive_windows import adapt_settings
from vo.features.image_quality import measure_image_quality

RNG = np.random.default_rng(4)


def _texture(deviation: float) -> np.ndarray:
    """Smooth random texture (480, 640) of a known standard deviation, with calm corners."""
    smooth = cv2.GaussianBlur(RNG.standard_normal((480, 640)), (0, 0), 4.0)
    return deviation * smooth / smooth.std()


@pytest.mark.parametrize("noise", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("texture", [6.0, 12.0, 20.0])
def test_ratio_is_that_of_the_energies(noise: float, texture: float) -> None:
    picture = 128 + _texture(texture) + noise * RNG.standard_normal((480, 640))
    image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    # Variance within a block misses what is slower than the block; the calmest blocks underrate
    # the noise a little.
    ratio = (texture / noise) ** 2
    found = measure_image_quality(image)
    assert 0.5 * ratio < found.texture_to_noise < 1.3 * ratio + 0.2
    assert found.noise == pytest.approx(noise, rel=0.15)


def test_a_flat_noisy_image_has_no_texture_and_a_clean_one_no_noise() -> None:
    flat = np.clip(128 + 5 * RNG.standard_normal((480, 640)), 0, 255).astype(np.uint8)
    assert (
        measure_image_quality(flat).texture_to_noise < 0.5
    )  # the calmest blocks underrate the noise a little
    clean = np.rint(128 + _texture(20.0)).astype(np.uint8)
    assert measure_image_quality(clean).texture_to_noise > 100
    assert measure_image_quality(np.zeros((10, 10), np.uint8)).texture_to_noise == np.inf


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_softness_tells_a_lens_out_of_focus_from_motion_blur_and_from_sharp_texture(noise) -> None:
    def softness(sigma_u: float, sigma_v: float) -> float:
        picture = RNG.standard_normal((480, 640))
        blurred = cv2.GaussianBlur(picture, (0, 0), sigmaX=sigma_u, sigmaY=sigma_v)
        picture = 128 + 12 * blurred / blurred.std() + noise * RNG.standard_normal((480, 640))
        return measure_image_quality(np.clip(np.rint(picture), 0, 255).astype(np.uint8)).softness

    limit = OdometrySettings().defocus.softness
    # Of Gaussian texture the energy over a distance is 1 - exp(-distance² / 4 sigma²).
    expected = (1 - np.exp(-16 / 4 / 4**2)) / (1 - np.exp(-4 / 4 / 4**2))
    assert softness(4, 4) == pytest.approx(expected, rel=0.1)  # noise is underrated a little
    assert softness(4, 4) > limit > softness(1, 1)
    assert softness(8, 1) < limit
    assert softness(1, 8) < limit


def test_faint_and_soft_images_are_met_with_wider_windows_and_nothing_else() -> None:
    usual = OdometrySettings()
    assert adapt_settings(usual, low_snr=False, defocus=False) == usual

    faint = adapt_settings(usual, low_snr=True, defocus=False)
    assert (faint.matching.align_px, faint.stereo.align_px, faint.stereo.patch_px) == (13, 13, 17)
    assert faint.stereo.max_sigma_px == pytest.approx(0.6)
    assert faint.features == usual.features

    soft = adapt_settings(usual, low_snr=False, defocus=True)
    assert (soft.matching.align_px, soft.stereo.align_px, soft.stereo.patch_px) == (19, 19, 17)
    assert soft.stereo.max_sigma_px == usual.stereo.max_sigma_px
    assert soft.features.threshold == usual.features.threshold / 2

    both = adapt_settings(usual, low_snr=True, defocus=True)
    assert (both.matching, both.features) == (soft.matching, soft.features)
    assert both.stereo.max_sigma_px == pytest.approx(0.6)
    for settings in (faint, soft, both):
        assert (settings.motion, settings.refinement) == (usual.motion, usual.refinement)
    assert THESIS.low_snr.texture_to_noise == THESIS.defocus.softness == 0
