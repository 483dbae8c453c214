"""Texture over noise against images whose noise and texture are known."""

import cv2
import numpy as np
import pytest

from vo.config import THESIS, OdometrySettings
from vo.noise import grain, widened

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
    found = grain(image)
    assert 0.5 * ratio < found.texture_to_noise < 1.3 * ratio + 0.2
    assert found.noise == pytest.approx(noise, rel=0.15)


def test_a_flat_noisy_image_has_no_texture_and_a_clean_one_no_noise() -> None:
    flat = np.clip(128 + 5 * RNG.standard_normal((480, 640)), 0, 255).astype(np.uint8)
    assert grain(flat).texture_to_noise < 0.5  # the calmest blocks underrate the noise a little
    clean = np.rint(128 + _texture(20.0)).astype(np.uint8)
    assert grain(clean).texture_to_noise > 100
    assert grain(np.zeros((10, 10), np.uint8)).texture_to_noise == np.inf


def test_faint_images_are_met_with_wider_windows_and_nothing_else() -> None:
    usual = OdometrySettings()
    wide = widened(usual)
    assert (wide.matching.align_px, wide.stereo.align_px, wide.stereo.search_px) == (13, 13, 17)
    assert wide.stereo.most_sigma_px == pytest.approx(0.6)
    assert (wide.motion, wide.refinement) == (usual.motion, usual.refinement)
    assert THESIS.faint.texture_to_noise == 0
