"""Landmarks of a sharp keyframe in an image that moves during the exposure, and the reverse."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vo.config import OdometrySettings
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.image_quality import SMEARED, measure_image_quality
from vo.map.frame import Detection, View
from vo.map.local_map import Keyframe, empty_map
from vo.patches.motion_blur import blur_along, missing_blur
from vo.tracking.landmark_alignment import align_landmarks
from vo.tracking.smear import estimate_smear

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
DISPARITY_PX, FLOW_PX, EXPOSURE = 12.0, 30.0, 0.6
"""How far a wall moves to the left from frame to frame, and the share of it that blurs."""


def wall(shift_px, path_px=0.0):
    """A wall (240, 320) so many pixels further left, as the mean along a path of the image."""
    coarse = np.random.default_rng(3).integers(30, 226, (72, 120), dtype=np.uint8)
    wide = cv2.resize(coarse, (480, 288), interpolation=cv2.INTER_CUBIC).astype(np.float32)
    places = 60 + shift_px + np.linspace(-0.5, 0.5, 33) * path_px
    seen = [cv2.getRectSubPix(wide, (320, 240), (x + 159.5, 139.5)) for x in places]
    return np.ascontiguousarray(np.rint(np.mean(seen, axis=0)), dtype=np.uint8)


def view_of(left, is_smeared):
    detection = Detection(lambda: (np.zeros((0, 2)), np.zeros((0, 169))))
    frame, settings = StereoFrame(1, left, left), OdometrySettings()
    return View(frame, RIG, detection, np.zeros((0, 0)), settings, is_smeared=is_smeared)


def map_of(left):
    """A map of one keyframe at the origin, with landmarks all over the wall."""
    u, v = np.meshgrid(np.arange(60.0, 300, 20), np.arange(40.0, 200, 20))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    n = len(pixels)
    depth_m = RIG.f_px * RIG.baseline_m / DISPARITY_PX
    seen = Observations(np.arange(n), pixels, np.full(n, DISPARITY_PX))
    landmarks = replace(
        empty_map().landmarks,
        ids=np.arange(n),
        points_odom=np.column_stack([RIG.normalized(pixels), np.ones(n)]) * depth_m,
        spread_odom=np.zeros((n, 3)),
        descriptors=np.zeros((n, 169)),
        views=np.full(n, 3),
        anchor=np.zeros(n, np.int64),
        anchor_pixels=pixels,
        anchor_depth_m=np.full(n, depth_m),
        anchor_slopes=np.zeros((n, 2)),
    )
    keyframe = Keyframe(left, seen, 0, np.eye(4), np.zeros((6, 6)))
    return replace(empty_map(), keyframes=(keyframe,), landmarks=landmarks, next_serial=1)


def moved():
    """Pose of the camera after the wall's motion to the left."""
    T_odom_cam = np.eye(4)
    T_odom_cam[0, 3] = FLOW_PX / RIG.f_px * RIG.f_px * RIG.baseline_m / DISPARITY_PX
    return T_odom_cam


def errors_px(local_map, view):
    """Correlations of the aligned landmarks, and errors of their columns."""
    rows = np.arange(len(local_map.landmarks))
    expected = local_map.landmarks.anchor_pixels - (FLOW_PX, 0)
    found = align_landmarks(local_map, view, moved(), rows, expected + 0.7)
    known = np.isfinite(found.zncc)
    assert known.sum() > 30
    return found.zncc[known], np.abs(found.pixels - expected)[known, 0]


def test_smear_is_found_by_what_is_most_alike():
    blurred = wall(FLOW_PX, EXPOSURE * FLOW_PX)
    assert measure_image_quality(wall(0)).smear < SMEARED < measure_image_quality(blurred).smear
    local_map, view = map_of(wall(0)), view_of(blurred, is_smeared=True)
    before, loose = errors_px(local_map, view)
    view = estimate_smear(local_map, local_map.keyframes[0], view, moved())
    np.testing.assert_allclose(view.path_px, [-EXPOSURE * FLOW_PX, 0], atol=0.05)
    after, exact = errors_px(local_map, view)
    assert np.median(before) < 0.85 < 0.97 < np.median(after)
    assert np.median(exact) < 0.1 < np.median(loose)


def test_sharp_image_is_blurred_like_a_smeared_keyframe():
    blurred = map_of(wall(0, 18.0))
    known = replace(blurred.keyframes[0], path_px=np.array([18.0, 0]))
    local_map = replace(blurred, keyframes=(known,))
    view = view_of(wall(FLOW_PX), is_smeared=False)
    before, _ = errors_px(blurred, view)
    view = estimate_smear(local_map, known, view, moved())
    np.testing.assert_array_equal(view.path_px, [0, 0])
    after, _ = errors_px(local_map, view)
    assert np.median(before) < 0.85 < 0.97 < np.median(after)


def test_nothing_is_set_without_a_smeared_image():
    local_map, view = map_of(wall(0)), view_of(wall(FLOW_PX), is_smeared=False)
    assert estimate_smear(local_map, local_map.keyframes[0], view, moved()) is view


@pytest.mark.parametrize("path_px", [(9.0, 0), (0, 6.5), (5.0, -4.0), (3.0, 0.5)])
def test_blur_spreads_a_point_along_its_path(path_px):
    point = np.zeros((41, 41), np.uint8)
    point[20, 20] = 255
    blurred = blur_along(point, np.array(path_px)).astype(float)
    y, x = np.mgrid[-20:21, -20:21]
    weight = blurred / blurred.sum()
    assert abs((weight * x).sum()) < 0.05
    assert abs((weight * y).sum()) < 0.05
    if np.hypot(*path_px) > 4:  # that of a path, and of bilinear weights
        np.testing.assert_allclose((weight * x**2).sum(), path_px[0] ** 2 / 12, atol=0.3)
        np.testing.assert_allclose((weight * x * y).sum(), np.prod(path_px) / 12, atol=0.3)


def test_each_image_gets_the_blur_that_only_the_other_has():
    mine, other = missing_blur(np.array([3.0, 0]), np.array([5.0, 0]))
    np.testing.assert_allclose(np.abs(mine), [4, 0], atol=1e-9)
    np.testing.assert_allclose(other, [0, 0], atol=1e-9)
    mine, other = missing_blur(np.array([0.0, 6]), np.array([8.0, 0]))
    np.testing.assert_allclose(np.abs([mine, other]), [[8, 0], [0, 6]], atol=1e-9)
