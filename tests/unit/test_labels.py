"""Dense labels on images small enough to work out by hand, and on worlds solved ray by ray."""

import math
from dataclasses import replace

import numpy as np
import pytest
from raycast import Ball, Box, Ground, look

from sim.camera.camera import FrameExposure
from sim.certificate.blur import FACTOR, CameraMotion
from sim.certificate.certificate import certify
from sim.certificate.photometric import (
    FrameResidual,
    NoisyImage,
    PhotometricCheck,
    expected_residual,
    residual,
)
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.resample import sample, sample_variance
from sim.labels.labels import (
    disparity_from_depth,
    flow,
    normals,
    visible_in_right,
)
from sim.settings import RecordSettings
from vo.contract import se3
from vo.contract.rig import StereoRig

WIDE = StereoRig(width_px=160, height_px=120, f_px=114, cx_px=79.5, cy_px=59.5, baseline_m=0.09)
SHOT = FrameExposure(timestamp_ns=0, exposure_ms=0.0, gain=1.0, subframes=1, brightness=1.0)
RIG = StereoRig(width_px=12, height_px=8, f_px=100, cx_px=5.5, cy_px=3.5, baseline_m=0.1)


def test_disparity_is_f_b_over_z():
    depth_m = np.array([[1.0, 2.0, np.nan]], dtype=np.float32)
    disparity_px = disparity_from_depth(RIG, depth_m)
    assert disparity_px.dtype == np.float32
    np.testing.assert_array_equal(disparity_px, [[10, 5, np.nan]])


def test_visible_in_right_near_post_hides_far_wall():
    """Wall at 1 px, post at u = 7, 8 with 4 px: it lands on 3, 4 and hides the wall's 4, 5."""
    disparity_px = np.full((1, 12), 1.0, dtype=np.float32)
    disparity_px[0, 7:9] = 4.0
    visible = visible_in_right(disparity_px)[0]
    assert np.flatnonzero(~visible).tolist() == [0, 4, 5]


@pytest.mark.parametrize(("step_px", "hidden"), [(0.95, []), (1.05, [4, 5])])
def test_visible_in_right_hides_steps_beyond_one_pixel(step_px, hidden):
    """Pixel 6 lands on or between those of pixels 4 and 5, which are farther by the step."""
    disparity_px = np.full((1, 12), 2.0, dtype=np.float32)
    disparity_px[0, 6] += step_px
    visible = visible_in_right(disparity_px)[0]
    assert np.flatnonzero(~visible[2:]).tolist() == [u - 2 for u in hidden]


def test_visible_in_right_excludes_sky_and_outside():
    disparity_px = np.array([[1.0, np.nan, 2.0, 3.5]], dtype=np.float32)
    np.testing.assert_array_equal(visible_in_right(disparity_px), [[False, False, True, False]])


def test_visible_in_right_sloped_ground_is_visible():
    disparity_px = np.linspace(5, 60, 120, dtype=np.float32)[:, None].repeat(160, axis=1)
    u = np.arange(160)
    np.testing.assert_array_equal(visible_in_right(disparity_px), u - disparity_px >= 0)


def test_residual_of_a_shifted_image_is_zero():
    rng = np.random.default_rng(0)
    right = rng.integers(0, 256, (2, 12)).astype(np.uint8)
    left = np.roll(right, 3, axis=1)
    disparity_px = np.full((2, 12), 3.0, dtype=np.float32)
    visible = visible_in_right(disparity_px)
    assert visible.sum() == 18
    v, u = np.indices(disparity_px.shape, np.float32)
    np.testing.assert_allclose(residual(left, right, u - disparity_px, v, visible), 0)


def test_certificate_names_the_worst_frame_and_fails():
    settings = RecordSettings()
    judge = PhotometricCheck(
        settings, RIG, [ImageSensor(settings, side, RIG, RIG) for side in (0, 1)]
    )
    right = np.full((8, 12), 100, dtype=np.uint8)
    disparity_px = np.full((8, 12), 1.0, dtype=np.float32)
    frames = [
        FrameResidual(
            time_ns, judge.stereo(right + np.uint8(error), right, disparity_px, SHOT), None
        )
        for time_ns, error in ((1, 0), (2, 1), (3, 5), (4, 0))
    ]
    stereo = certify(frames, {})["stereo"]
    assert stereo["worst_frame_ns"] == 3
    assert stereo["worst_frame_median_grey"] == 5.0
    assert stereo["rms_grey"] == pytest.approx(np.sqrt((1 + 25) / 4), abs=1e-3)
    assert stereo["visible_fraction"] == pytest.approx(11 / 12, abs=1e-6)
    assert stereo["failed_frames_ns"] == [2, 3]
    assert not certify(frames, {})["passed"]
    assert certify(frames[:1], {})["passed"]
    assert not certify(frames[:1], {"inertial": {"passed": False}})["passed"]


def test_normals_are_exact_on_planes_and_nan_elsewhere():
    R = np.array([[0, -0.34, 0.94], [-1, 0, 0], [0, -0.94, -0.34]])
    T_world_cam = se3.pose(se3.exp(np.array([0, 0, 0, 0, 0, 0.2]))[:3, :3] @ R, np.array([0, 0, 1]))
    T_world_cam[:3, :3] = (
        np.linalg.svd(T_world_cam[:3, :3])[0] @ np.linalg.svd(T_world_cam[:3, :3])[2]
    )
    box = Box((0.3, 0.3, 0.3), se3.exp(np.array([2.0, 0.2, 0.3, 0, 0, 0.5])))
    ball = Ball(0.2, se3.exp(np.array([1.6, -0.3, 0.2, 0, 0, 0])))
    view = look([Ground(), box, ball], WIDE, T_world_cam)
    ours = normals(WIDE, view.depth_m)
    known = np.isfinite(ours).all(axis=-1)
    planes = (view.shapes == 0) | (view.shapes == 1)
    assert known[planes].mean() > 0.99
    assert not known[~planes].any()
    cosine = (ours * view.normals_cam)[known].sum(axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.05
    np.testing.assert_allclose(np.linalg.norm(ours[known], axis=-1), 1, atol=1e-6)


def test_flow_of_a_point_behind_the_next_camera_is_nan():
    """Body 0 comes 1.5 m nearer, and body 1 exactly to the camera."""
    depth_m = np.array([[1.0, 2.0, 1.0, np.nan]], dtype=np.float32)
    bodies = np.array([[0, 0, 1, 0]], dtype=np.int32)
    T_next_now = np.tile(np.eye(4), (2, 1, 1))
    T_next_now[:, 2, 3] = -1.5, -1.0
    moved = flow(WIDE, depth_m, bodies, T_next_now)[0]
    assert np.isnan(moved[[0, 2]]).all()
    assert moved[1, 2] == pytest.approx(0.5)
    assert np.isfinite(moved[3, :2]).all()


def test_flow_of_sky_and_of_moving_bodies():
    depth_m = np.full((120, 160), np.nan, np.float32)
    depth_m[60:] = 2.0
    bodies = np.zeros((120, 160), np.int32)
    bodies[90:] = 1
    turned = se3.exp(np.array([0.1, -0.05, 0.2, 0.0, 0.02, 0.01]))
    pushed = se3.pose(np.eye(3), np.array([0.1, 0, 0.5]))
    moved = flow(WIDE, depth_m, bodies, np.stack([turned, pushed @ turned]))
    assert np.isnan(moved[:60, :, 2]).all()

    for v, u in ((5, 10), (70, 20), (100, 150)):
        body = pushed @ turned if bodies[v, u] else turned
        ray = np.array([(u - WIDE.cx_px) / WIDE.f_px, (v - WIDE.cy_px) / WIDE.f_px, 1])
        far = np.isnan(depth_m[v, u])
        p = turned[:3, :3] @ ray if far else body[:3, :3] @ ray * 2 + body[:3, 3]
        pixel = WIDE.f_px * p[:2] / p[2] + (WIDE.cx_px, WIDE.cy_px)
        np.testing.assert_allclose(moved[v, u, :2], pixel - (u, v), atol=1e-4)
        if not far:
            assert moved[v, u, 2] == pytest.approx(p[2], rel=1e-6)


def test_sample_is_exact_on_parabolas():
    v, u = np.indices((12, 16)).astype(np.float32)
    image = 3 + 0.5 * u - 0.2 * v + 0.03 * u * u - 0.05 * v * v + 0.1 * u * v
    rng = np.random.default_rng(2)
    x, y = rng.uniform(1, 10, (2, 5, 7)).astype(np.float32)
    expected = 3 + 0.5 * x - 0.2 * y + 0.03 * x * x - 0.05 * y * y + 0.1 * x * y
    np.testing.assert_allclose(sample(image, x, y), expected, atol=2e-5)
    both = sample(np.stack([image, 2 * image], axis=-1), x, y)
    np.testing.assert_allclose(both, np.stack([expected, 2 * expected], axis=-1), atol=4e-5)


def test_sample_continues_the_border_and_keeps_nan():
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    u = np.array([[-5, 9, 0, np.nan]], np.float32)
    v = np.array([[0, 2, -3, 1]], np.float32)
    np.testing.assert_array_equal(sample(image, u, v), [[0, 11, 0, np.nan]])


def test_sample_at_border_agrees_with_padded_image():
    image = np.random.default_rng(9).random((7, 9), dtype=np.float32)
    padded = np.pad(image, 6, mode="edge")
    v, u = np.mgrid[-2:9:0.25, -2:11:0.25].astype(np.float32)
    np.testing.assert_allclose(sample(image, u, v), sample(padded, u + 6, v + 6), atol=1e-6)


@pytest.mark.parametrize(("phase_u", "phase_v"), [(0, 0), (0.5, 0), (0.3, 0.8)])
def test_sample_variance_agrees_with_measurement(phase_u: float, phase_v: float):
    rng = np.random.default_rng(3)
    noise = 5 * rng.standard_normal((400, 400), dtype=np.float32)
    v, u = np.indices(noise.shape).astype(np.float32)
    u, v = u[5:-5, 5:-5] + np.float32(phase_u), v[5:-5, 5:-5] + np.float32(phase_v)
    promised = sample_variance(np.full_like(noise, 25), u, v)
    assert promised.std() < 1e-3
    assert sample(noise, u, v).var() == pytest.approx(promised.mean(), rel=0.03)


def _noisy_pair(rng: np.random.Generator, color: bool) -> tuple[np.ndarray, np.ndarray]:
    """Smooth images, the right one moved by 3.5 px, with a noise of 4 and 6 grey levels."""
    shape = (200, 300, 3) if color else (200, 300)
    u = np.arange(300)[:, None] if color else np.arange(300)
    left = 120 + 40 * np.sin(u / 20) + 4 * rng.standard_normal(shape)
    right = 120 + 40 * np.sin((u + 3.5) / 20) + 6 * rng.standard_normal(shape)
    return np.rint(left).astype(np.uint8), np.rint(right).astype(np.uint8)


@pytest.mark.parametrize("color", [False, True])
def test_expected_residual_explains_only_the_right_label(color: bool):
    left, right = _noisy_pair(np.random.default_rng(4), color)
    v, u = np.indices((200, 300)).astype(np.float32)
    visible = (u > 10) & (u < 290)
    sigma_left, sigma_right = np.full(256, 4.0), np.full(256, 6.0)
    noisy = NoisyImage(left, sigma_left), NoisyImage(right, sigma_right)
    expected = expected_residual(*noisy, u - 3.5, v, visible)
    measured = residual(left, right, u - 3.5, v, visible)
    ratio = math.sqrt((measured**2).mean() / (expected**2).mean())
    assert ratio == pytest.approx(1, abs=0.01)
    wrong = residual(left, right, u - 6.5, v, visible)
    assert math.sqrt((wrong**2).mean() / (expected**2).mean()) > 1.1


def test_expected_residual_without_noise_is_rounding():
    image = np.full((8, 12), 100, np.uint8)
    v, u = np.indices((8, 12)).astype(np.float32)
    visible = np.ones((8, 12), bool)
    noiseless = NoisyImage(image, np.zeros(256))
    expected = expected_residual(noiseless, noiseless, u, v, visible)
    np.testing.assert_allclose(expected, math.sqrt(1 / 6), rtol=1e-6)


@pytest.mark.parametrize(("faster", "expected_px"), [(0.0, 0.0), (2.0, 2 * 114 * 0.02 / 8)])
def test_blur_displaces_an_image_where_the_camera_accelerates(faster, expected_px):
    """The turn rate is `faster` in the second half of an exposure of 20 ms: a mean of 2/8 T."""
    times_ns = np.arange(0, 100_000_001, 5_000_000)
    seconds = times_ns * 1e-9
    turned = seconds + faster * np.maximum(seconds - 0.05, 0)
    T_world_cam = np.stack([se3.exp(np.array([0, 0, 0, 0, a, 0])) for a in turned])
    motion = CameraMotion(times_ns, T_world_cam, WIDE)
    shot = replace(SHOT, timestamp_ns=50_000_000, exposure_ms=20.0)
    displaced_px = motion.displacement_px(shot, np.full((120, 160), 10, np.float32))
    assert displaced_px == pytest.approx(FACTOR * expected_px, rel=0.05, abs=1e-6)
    assert motion.displacement_px(replace(shot, exposure_ms=0.0), np.ones((2, 2))) == 0
