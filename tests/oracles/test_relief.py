"""Landmarks on bricks that lie half a pixel nearer than the joints between them."""

import numpy as np
import pytest

from tests.oracles.test_stereo import Plane
from vo.config import OdometrySettings, StereoSettings
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS
from vo.map.local_map import empty_map
from vo.mapping.keyframes import add_keyframe
from vo.stereo.relief import has_relief
from vo.stereo.sparse import measure_disparities
from vo.tracking.frontend import Frontend

WIDTH, HEIGHT = 500, 360
RIG = StereoRig(WIDTH, HEIGHT, 300.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, 0.1)
TOP_PX, JOINT_PX = 30.4, 29.7
"""Disparities of the bricks' tops and of the joints between them."""
PAVED_ROWS = 110
"""Rows above which there are joints; below, there is one level surface."""
SUBSAMPLES = 4
"""Samples of a pixel along the row."""


def is_joint(u, v):
    """Whether a ray of the left camera, were there tops alone, would meet a joint."""
    return ((np.mod(u + 11 * (v // 20), 24) < 4) | (np.mod(v, 20) < 4)) & (v < PAVED_ROWS)


def render(shift):
    """Render the left camera's image, shift 0, or the right one's, 1."""
    top, joint = (Plane(0.0, 0.0, 0.0, seed).wave for seed in (1, 2))
    fine = (np.arange(WIDTH * SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    u, v = np.meshgrid(fine, np.arange(HEIGHT))
    tops = 150 + 6 * top(u + shift * TOP_PX, v)
    joints = 60 + 3 * joint(u + shift * JOINT_PX, v)
    grey = np.where(is_joint(u + shift * TOP_PX, v), joints, tops)
    grey = grey.reshape(HEIGHT, WIDTH, SUBSAMPLES).mean(axis=2)
    return np.round(grey).clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def landmarks():
    """Pixels (N, 2), disparities and true disparities (N,) of the landmarks of a first keyframe."""
    frame = StereoFrame(0, render(0), render(1))
    view = Frontend(RIG, OdometrySettings()).process(frame, 0.0, False, NO_HOOKS, Clock())
    first = add_keyframe(empty_map(), view, np.eye(4), np.zeros((6, 6)))
    seen = first.keyframes[0].observations
    u, v = np.rint(seen.pixels).T
    return seen.pixels, seen.disparity_px, np.where(is_joint(u, v), JOINT_PX, TOP_PX)


def test_landmarks_on_bricks_have_unbiased_disparities(landmarks):
    """Median 0.10 px, and 40 % wrong by more than 0.3 px, where edges give landmarks, too."""
    pixels, found, true = landmarks
    error_px = (found - true)[pixels[:, 1] < PAVED_ROWS]
    assert len(error_px) > 40
    assert np.abs(np.median(error_px)) < 0.01
    assert (np.abs(error_px) > 0.3).mean() < 0.1


def test_landmarks_on_a_level_surface_are_kept(landmarks):
    pixels, found, true = landmarks
    level = pixels[:, 1] > PAVED_ROWS
    assert level.sum() > 350
    assert np.abs((found - true)[level]).max() < 0.3


def test_noise_is_no_relief():
    """Grey levels of one plane with noise, and of contrasts from 8 to 1."""
    rng = np.random.default_rng(0)
    plane = Plane(30.4, 0.0, 0.0, seed=1).frame
    height, width = plane.left.shape
    contrast = np.repeat([1.0, 0.5, 0.25, 0.125], height // 4)[:, None]

    def noisy(image):
        grey = 128 + contrast * (image.astype(float) - 128) + rng.normal(0, 3, image.shape)
        return np.round(grey).clip(0, 255).astype(np.uint8)

    frame = StereoFrame(0, noisy(plane.left), noisy(plane.right))
    places = rng.uniform([130, 25], [width - 26, height - 26], (300, 2))
    found = measure_disparities(frame, np.zeros((0, 0)), places, StereoSettings())
    assert found.known.sum() > 150
    assert has_relief(found).sum() < 0.05 * found.known.sum()


def test_relief_is_unknown_without_alignment():
    frame = Plane(30.4, 0.0, 0.0).frame
    places = np.random.default_rng(0).uniform([130, 25], [370, 210], (60, 2))
    found = measure_disparities(frame, np.zeros((0, 0)), places, StereoSettings(refine=False))
    assert found.known.any()
    assert not has_relief(found).any()
