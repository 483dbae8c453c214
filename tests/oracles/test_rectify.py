"""Rectification of a raw, distorted, toed-in pair, judged by points whose place is known."""

import cv2
import numpy as np
import pytest
from folders import HEIGHT, WIDTH, write_euroc

from vo.contract import se3
from vo.recordings.readers import open_sequence

K = np.array([[180.0, 0, 118.0], [0, 185.0, 92.0], [0, 0, 1]])
DISTORTION = (-0.28, 0.07, 2e-4, -3e-4)
BLOB_SIGMA_PX = 2.5


RATIONAL = (-0.28, 0.07, 2e-4, -3e-4, 0.01, 0.02, -0.01, 0.003)
EQUIDISTANT = (0.01, -0.011, 0.006, -0.0017)


def blob_image(points_cam, distortion, lens):
    """Gaussian dots where OpenCV's own distortion model sees the points."""
    nothing, coefficients = np.zeros(3), np.r_[distortion, np.zeros(max(0, 4 - len(distortion)))]
    if lens == "equidistant":
        pixels = cv2.fisheye.projectPoints(points_cam[:, None], nothing, nothing, K, coefficients)[
            0
        ]
        pixels = pixels.reshape(-1, 1, 2)
    else:
        pixels = cv2.projectPoints(points_cam, nothing, nothing, K, coefficients)[0]
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    image = np.zeros((HEIGHT, WIDTH))
    for x, y in pixels[:, 0]:
        image += 250 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * BLOB_SIGMA_PX**2))
    return np.round(image).clip(0, 255).astype(np.uint8)


def centroid(image, near, reach=7):
    u0, v0 = np.round(near).astype(int)
    window = image[v0 - reach : v0 + reach + 1, u0 - reach : u0 + reach + 1].astype(float)
    v, u = np.mgrid[v0 - reach : v0 + reach + 1, u0 - reach : u0 + reach + 1]
    return np.array([(u * window).sum(), (v * window).sum()]) / window.sum()


@pytest.mark.parametrize(
    ("lens", "distortion"),
    [
        ("radial-tangential", DISTORTION),
        ("radial-tangential", ()),
        ("radial-tangential", DISTORTION[:2]),
        ("radial-tangential", RATIONAL[:5]),
        ("radial-tangential", RATIONAL),
        ("equidistant", EQUIDISTANT),
        ("equidistant", (0, 0, 0, 0)),
    ],
)
def test_rectify_agrees_with_known_points(tmp_path, lens, distortion):
    # The body is ahead of the cameras and turned; the cameras are toed in and unevenly mounted.
    T_body_left = se3.exp(np.array([0.2, -0.1, 0.3, 0.02, -0.4, 0.03]))
    T_left_right = se3.exp(np.array([0.12, 0.004, -0.003, 0.01, -0.03, 0.015]))
    T_body_right = T_body_left @ T_left_right
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 4), np.linspace(-0.6, 0.6, 3))
    points_left = np.stack([x.ravel(), y.ravel(), 2.0 + 0.3 * x.ravel()], axis=-1)
    points_body = se3.transform(T_body_left, points_left)
    pair = tuple(
        blob_image(se3.transform(se3.inverse(T), points_body), distortion, lens)
        for T in (T_body_left, T_body_right)
    )
    folder = write_euroc(tmp_path / "raw", [pair], K, distortion, (T_body_left, T_body_right))
    for eye in (0, 1):
        sheet = folder / "mav0" / f"cam{eye}" / "sensor.yaml"
        sheet.write_text(sheet.read_text().replace("radial-tangential", lens))

    sequence = open_sequence(folder)
    rig, frame = sequence.rig, sequence[0]
    expected = rig.project(se3.transform(se3.inverse(rig.T_body_cam), points_body))
    inside = np.abs(expected[:, :2] - [WIDTH / 2, HEIGHT / 2]) < [WIDTH / 2 - 20, HEIGHT / 2 - 10]
    inside = inside.all(axis=1) & (expected[:, 0] - expected[:, 2] > 10)
    assert inside.sum() >= 6
    for u, v, disparity_px in expected[inside]:
        left = centroid(frame.left, (u, v))
        right = centroid(frame.right, (u - disparity_px, v))
        assert np.abs(left - [u, v]).max() < 0.15
        assert np.abs(right - [u - disparity_px, v]).max() < 0.15
        assert abs(left[1] - right[1]) < 0.1
    assert np.isclose(rig.baseline_m, np.linalg.norm(T_left_right[:3, 3]))
