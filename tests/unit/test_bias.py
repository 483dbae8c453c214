"""The bias of labels on made-up textures whose true motion is known exactly."""

import cv2
import numpy as np
import pytest

from sim.certificate import bias
from sim.certificate.photometric import Residual

SHAPE = 240, 320
MOTION_PX = 3.37, -2.21
NOISE = 15.0


def texture(seed: int = 0) -> np.ndarray:
    """Return a periodic texture (H, W) float32 with slopes of some grey levels per pixel."""
    white = np.random.default_rng(seed).normal(size=SHAPE)
    smooth = cv2.GaussianBlur(np.tile(white, (3, 3)), (0, 0), 2.0)[240:480, 320:640]
    return (128 + 12 * smooth / smooth.std()).astype(np.float32)


def moved(image: np.ndarray, by_px: tuple[float, float]) -> np.ndarray:
    """Move an image by whole and fractional pixels along u and v, exactly, by Fourier's theorem."""
    frequencies = (
        np.fft.fftfreq(SHAPE[1])[None] * by_px[0] + np.fft.fftfreq(SHAPE[0])[:, None] * (by_px[1])
    )
    spectrum = np.fft.fft2(image) * np.exp(-2j * np.pi * frequencies)
    return np.fft.ifft2(spectrum).real.astype(np.float32)


def shift_of(image, other, label_px, channels=2, H=None, visible=None):
    motion = np.zeros((*SHAPE, 3), np.float32)
    motion[..., :2] = label_px
    visible = np.ones(SHAPE, bool) if visible is None else visible
    return bias.shift_of(image, other, motion, visible, np.eye(3) if H is None else H, channels, 1)


def noisy_pair(sigma=NOISE, seed=0, by_px=MOTION_PX):
    image, rng = texture(seed), np.random.default_rng(seed + 100)
    pair = image, moved(image, by_px)
    return [(x + rng.normal(scale=sigma, size=SHAPE)).astype(np.float32) for x in pair]


@pytest.mark.parametrize("sigma", [0.0, 5.0, NOISE])
def test_bias_of_a_label_is_estimated_within_its_error(sigma):
    pair = noisy_pair(sigma=sigma)
    for by_px in ((0.0, 0.0), (0.2, -0.1), (-0.3, 0.0)):
        estimate, error = shift_of(*pair, np.add(MOTION_PX, by_px)).estimate()
        assert (np.abs(estimate - by_px) < 3 * error + 0.015).all()


def test_standard_error_is_right_and_near_the_bound():
    """The bound is the Cramér-Rao bound for all pixels, with noise in both images."""
    found = [shift_of(*noisy_pair(seed=k), MOTION_PX).estimate() for k in range(12)]
    estimates, errors = np.array(found).transpose(1, 0, 2)
    assert 0.5 < (estimates / errors).std() < 1.1
    slopes = np.gradient(texture(), axis=1)
    bound_px = (2 * NOISE**2 / (slopes**2).sum()) ** 0.5
    assert bound_px < errors[:, 0].mean() < 3 * bound_px


@pytest.mark.parametrize("sigma", [2.0, NOISE])
@pytest.mark.parametrize("channels", [1, 2])
def test_stated_shift_is_found_and_a_third_of_it_not(sigma, channels):
    motion_px = np.array([MOTION_PX[0], MOTION_PX[1] * (channels - 1)])
    pair = noisy_pair(sigma, by_px=motion_px)
    limits = bias.FRAME_MAX_PX, bias.FRAME_ERRORS
    right = shift_of(*pair, motion_px, channels)
    assert not right.is_found(*limits)
    stated_px = right.smallest_found_px(*limits)
    assert stated_px < 0.4
    for by_px in stated_px * np.vstack([np.eye(2), -np.eye(2)])[:: 3 - channels]:
        assert shift_of(*pair, motion_px + by_px, channels).is_found(*limits)
        assert not shift_of(*pair, motion_px + by_px / 3, channels).is_found(*limits)


def test_shift_by_more_than_the_grain_lacks_common_gradients():
    shift = shift_of(*noisy_pair(sigma=5.0), np.add(MOTION_PX, (9.0, 5.0)))
    assert shift.is_found(bias.FRAME_MAX_PX, bias.FRAME_ERRORS)
    assert not shift.is_found(bias.FRAME_MAX_PX, bias.FRAME_ERRORS, steady=False)


def test_image_without_texture_has_no_bias_and_states_no_shift():
    flat = np.full(SHAPE, 99, np.float32)
    shift = shift_of(flat, flat, (0.0, 0.0))
    assert np.isnan(shift.estimate()).all()
    assert np.isnan(shift.smallest_found_px(0.1, 4.0))
    assert not shift.is_found(0.1, 4.0)


def test_hidden_pixels_do_not_count():
    image, other = noisy_pair(sigma=0.0)
    image[:, 20:60] = moved(image, (0.5, 0.5))[:, 20:60]
    visible = np.ones(SHAPE, bool)
    visible[:, 20:60] = False
    estimate, _ = shift_of(image, other, MOTION_PX, visible=visible).estimate()
    np.testing.assert_allclose(estimate, 0, atol=0.02)


def test_pixels_of_outlines_do_not_count():
    """Where the outline of a nearer surface is drawn, a pixel to the left or right, is the same."""
    label = np.empty((*SHAPE, 2), np.float32)
    label[:] = MOTION_PX
    label[:, 160:, 0] += 5
    estimates: list[np.ndarray] = []
    for drawn_at_u in (163, 164):
        image, other = noisy_pair()
        image[:, 160:], other[:, drawn_at_u:] = 220, 220
        estimates.append(shift_of(image, other, label).estimate()[0])
    np.testing.assert_array_equal(*estimates)


def test_pixels_that_show_something_else_do_not_count():
    image, other = noisy_pair(sigma=2.0)
    _, error = shift_of(image, other, MOTION_PX).estimate()
    other[100:140, 100:200] = 128 + 8 * (texture(9)[100:140, 100:200] - 128)
    _, error_of_rest = shift_of(image, other, MOTION_PX).estimate()
    assert (error_of_rest < 1.3 * error).all()


def test_clear_half_of_an_image_decides_beside_a_noisy_one():
    image, other = noisy_pair(sigma=2.0)
    _, clear = shift_of(image, other, MOTION_PX).estimate()
    other[:, 160:] += np.random.default_rng(3).normal(scale=60, size=(240, 160)).astype(np.float32)
    _, error = shift_of(image, other, MOTION_PX).estimate()
    assert (error < 1.7 * clear).all()


def test_highlights_that_move_otherwise_are_no_bias():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]

    def highlight(at_u):
        return 60 * np.exp(-((u - at_u) ** 2 + (v - 120.0) ** 2) / (2 * 40**2))

    image, other = noisy_pair(sigma=2.0)
    image, other = (image / 8 + highlight(150)), (other / 8 + highlight(165))
    shift = shift_of(image.astype(np.float32), other.astype(np.float32), MOTION_PX)
    assert not shift.is_found(bias.FRAME_MAX_PX, bias.FRAME_ERRORS)


def test_turned_camera_is_found_by_its_homography():
    H = np.eye(3)
    H[:2, 2] = -1.0, 0.5
    by_labels = tuple(np.array(MOTION_PX) - H[:2, 2])
    estimate, error = shift_of(*noisy_pair(), by_labels, H=H).estimate()
    assert (np.abs(estimate) < 3 * error + 0.01).all()


@pytest.mark.parametrize(
    ("width", "height", "sigma", "step"),
    [(320, 240, 0.0, 1), (640, 480, 0.0, 4), (640, 480, 10.0, 1), (1280, 960, 10.0, 4)],
)
def test_row_step_uses_more_rows_under_noise(width, height, sigma, step):
    assert bias.row_step(width * height, sigma) == step


def test_median_of_a_few_pixels_fails_no_frame():
    shift = shift_of(*noisy_pair(sigma=5.0), MOTION_PX)
    for visible, passed in ((0.009, True), (0.011, False)):
        histogram = np.eye(1, 2000, 1999, dtype=int)[0]
        assert Residual(histogram, 0.1, 0.1, visible, shift).passed == passed


def test_blurred_image_may_be_displaced_from_its_label():
    def passed(by_px, displacement_px):
        shift = shift_of(*noisy_pair(sigma=5.0), np.add(MOTION_PX, by_px))
        return Residual(np.ones(1, int), 0.0, 0.0, 1.0, shift, displacement_px).passed

    for by_px, without, with_blur in (
        ((0.0, 0.0), True, True),
        ((0.3, 0.0), False, True),
        ((0.9, 0.0), False, False),
        ((9.0, 5.0), False, True),  # blur may have removed what gradients have in common
    ):
        assert passed(by_px, 0.0) == without
        assert passed(by_px, 0.3) == with_blur
