"""Rotation between whole images of a far texture, rotated exactly."""

import cv2
import numpy as np
import pytest

from vo.contract import se3
from vo.contract.rig import StereoRig
from vo.tracking.rotation_prior import align_rotation

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
K = np.array([[RIG.f_px, 0, RIG.cx_px], [0, RIG.f_px, RIG.cy_px], [0, 0, 1]])


def rotation(degrees):
    return se3.exp(np.concatenate([np.zeros(3), np.radians(degrees)]))[:3, :3]


def off_deg(R, wanted):
    return np.degrees(se3.rotation_angle(se3.pose(R.T @ wanted, np.zeros(3))))


@pytest.fixture(scope="module")
def far():
    """A texture that a camera of 60 by 60 degrees would see."""
    coarse = np.random.default_rng(0).integers(30, 226, (20, 20), dtype=np.uint8)
    return cv2.resize(coarse, (800, 800), interpolation=cv2.INTER_CUBIC)


def view(far, R_far_cam):
    """What the rig sees of it, turned."""
    shift = np.array([[1.0, 0, 400 - RIG.cx_px], [0, 1, 400 - RIG.cy_px], [0, 0, 1]])
    H = shift @ K @ R_far_cam @ np.linalg.inv(K)
    size = RIG.width_px, RIG.height_px
    return cv2.warpPerspective(far, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


@pytest.mark.parametrize("degrees", [(0, 0, 0), (0, 12, 0), (-9, 0, 0), (0, 0, 10), (5, -8, 6)])
def test_rotation_of_many_degrees_is_found(far, degrees):
    wanted = rotation(degrees)
    before, now = view(far, np.eye(3)), view(far, wanted)
    darker = cv2.convertScaleAbs(now, alpha=0.6, beta=10)
    for image in (now, darker):
        assert off_deg(align_rotation(before, image, RIG, np.eye(3)), wanted) < 0.3


def test_rotation_prediction_helps_with_little_overlap(far):
    wanted = rotation((0, 28, 0))
    before, now = view(far, np.eye(3)), view(far, wanted)
    assert off_deg(align_rotation(before, now, RIG, rotation((0, 25, 0))), wanted) < 1
    assert off_deg(align_rotation(before, now, RIG, np.eye(3)), wanted) > 1


def test_rotation_of_blank_images_is_none():
    blank = np.full((240, 320), 90, np.uint8)
    assert off_deg(align_rotation(blank, blank, RIG, rotation((0, 5, 0))), np.eye(3)) < 0.1
