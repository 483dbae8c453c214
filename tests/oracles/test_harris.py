"""Harris corners against OpenCV's and against corners whose place is known."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from vo.config import FeatureSettings
from vo.features.detector import detect
from vo.features.harris import SIGMA_PX, harris_response

SETTINGS = FeatureSettings(detector="harris", count=10**6, threshold=1.0)


def noise(shape=(90, 110)):
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.uniform(0, 255, shape), (0, 0), 1.5)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def corner(u, v, shape=(80, 100)):
    """A white quadrant below and right of (u, v), its edges exactly as sharp as pixels allow."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    cover = np.clip(columns - u + 0.5, 0, 1) * np.clip(rows - v + 0.5, 0, 1)
    return np.round(40 + 160 * cover).astype(np.uint8)


@pytest.mark.parametrize("line_ratio", [2.0, 5.0])
def test_harris_response_equals_scipy(line_ratio):
    grey = noise().astype(float)
    dv, du = np.gradient(grey)
    uu, uv, vv = (ndimage.gaussian_filter(x, SIGMA_PX) for x in (du * du, du * dv, dv * dv))
    small, large = np.linalg.eigvalsh(np.stack([uu, uv, uv, vv], -1).reshape(*grey.shape, 2, 2)).T
    round_enough = (large < line_ratio * small).T[8:-8, 8:-8]
    ours = harris_response(noise(), line_ratio)[8:-8, 8:-8]
    assert 0.05 < round_enough.mean() < 0.95
    assert ours[~round_enough].max() < 0.3
    k = line_ratio / (line_ratio + 1) ** 2
    expected = ((small * large - k * (small + large) ** 2).clip(0) ** 0.25).T[8:-8, 8:-8]
    np.testing.assert_allclose(ours, expected, atol=0.3)
    assert np.corrcoef(ours.ravel(), expected.ravel())[0, 1] > 0.9999


def test_harris_strongest_corners_equal_opencv():
    """Its window is square, so not all agree."""
    image = noise((200, 240))
    ours = detect(image, SETTINGS.model_copy(update={"count": 60, "cell_px": 1000}))
    theirs = cv2.goodFeaturesToTrack(
        image, 90, 1e-4, 1, blockSize=5, useHarrisDetector=True, k=12 / 169
    )[:, 0]
    away = np.linalg.norm(ours[:, None] - theirs, axis=-1).min(axis=1)
    assert len(ours) == 60
    assert (away < 2).mean() > 0.9


@pytest.mark.parametrize(("u", "v"), [(50.0, 40.0), (50.3, 40.0), (49.8, 40.4)])
def test_harris_corner_moves_with_its_tip(u, v):
    found = detect(corner(u, v), SETTINGS)
    assert len(found) == 1
    whole = detect(corner(50, 40), SETTINGS)[0]
    assert np.hypot(*(whole - [50, 40])) < 1.5  # the window shifts it inwards
    assert np.abs(found[0] - whole - [u - 50, v - 40]).max() < 0.15


@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (5, 5), (61, 83)])
def test_harris_edge_or_flat_image_has_no_corners(shape):
    edge = np.zeros(shape, np.uint8)
    edge[:, shape[1] // 2 :] = 200
    for image in (edge, np.full(shape, 90, np.uint8)):
        found = detect(image, SETTINGS)
        assert len(found) == 0
        assert found.shape == (0, 2)


def test_harris_equal_neighbours_give_one_corner():
    image = np.zeros((40, 40), np.uint8)
    image[20:22, 20:22] = 255
    found = detect(image, SETTINGS)
    whole_numbers = {tuple(x) for x in np.round(found - 20.5)}
    assert len(whole_numbers) == len(found)
