"""Disparity, visibility and residual on images small enough to work out by hand."""

import numpy as np
import pytest

from sim.certificate import certify, measure_frame
from sim.labels import disparity_from_depth, photometric_residual, visible_in_right
from vo.contract.rig import StereoRig

RIG = StereoRig(width_px=12, height_px=2, f_px=100, cx_px=5.5, cy_px=0.5, baseline_m=0.1)


def test_disparity_is_f_b_over_z():
    depth_m = np.array([[1.0, 2.0, np.nan]], dtype=np.float32)
    disparity_px = disparity_from_depth(RIG, depth_m)
    assert disparity_px.dtype == np.float32
    np.testing.assert_array_equal(disparity_px, [[10, 5, np.nan]])


def test_a_near_post_hides_the_far_wall_to_its_left():
    """Wall at 1 px, post at u = 7, 8 with 4 px: it lands on 3, 4 and hides the wall's 4, 5."""
    disparity_px = np.full((1, 12), 1.0, dtype=np.float32)
    disparity_px[0, 7:9] = 4.0
    visible = visible_in_right(disparity_px)[0]
    assert np.flatnonzero(~visible).tolist() == [0, 4, 5]


def test_sky_and_what_leaves_the_image_are_not_visible():
    disparity_px = np.array([[1.0, np.nan, 2.0, 3.5]], dtype=np.float32)
    np.testing.assert_array_equal(visible_in_right(disparity_px), [[False, False, True, False]])


def test_a_ground_that_approaches_hides_nothing_of_itself():
    disparity_px = np.linspace(5, 60, 120, dtype=np.float32)[:, None].repeat(160, axis=1)
    u = np.arange(160)
    np.testing.assert_array_equal(visible_in_right(disparity_px), u - disparity_px >= 0)


def test_a_shifted_image_leaves_no_residual():
    rng = np.random.default_rng(0)
    right = rng.integers(0, 256, (2, 12)).astype(np.uint8)
    left = np.roll(right, 3, axis=1)
    disparity_px = np.full((2, 12), 3.0, dtype=np.float32)
    visible = visible_in_right(disparity_px)
    assert visible.sum() == 18
    np.testing.assert_allclose(photometric_residual(left, right, disparity_px, visible), 0)


def test_certificate_names_the_worst_frame_and_fails_on_it():
    right = np.full((8, 12), 100, dtype=np.uint8)
    disparity_px = np.full((8, 12), 1.0, dtype=np.float32)
    frames = [
        measure_frame(time_ns, right + np.uint8(error), right, disparity_px)
        for time_ns, error in ((1, 0), (2, 1), (3, 5), (4, 0))
    ]
    certificate = certify(frames)
    assert certificate["worst_frame_ns"] == 3
    assert certificate["worst_frame_median_grey"] == 5.0
    assert certificate["rms_grey"] == pytest.approx(np.sqrt((1 + 25) / 4), abs=1e-3)
    assert certificate["visible_fraction"] == pytest.approx(11 / 12, abs=1e-6)
    assert certificate["failed_frames_ns"] == [2, 3]
    assert not certificate["passed"]
    assert certify(frames[:1])["passed"]
