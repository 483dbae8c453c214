"""A mover that holds most of the features must not carry the camera with it."""

import cv2
import numpy as np
import pytest

from vo.config import OdometrySettings
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.odometry import StereoOdometry

WIDTH, HEIGHT = 320, 240
RIG = StereoRig(WIDTH, HEIGHT, 250.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, 0.1)
FAR_PX, NEAR_PX = 6, 10
"""Disparities of the wall, at 4.17 m, and of the panel before it, at 2.5 m."""
WALL_STEP_PX, PANEL_STEP_PX = 3, -4
STEP_M = WALL_STEP_PX / FAR_PX * RIG.baseline_m
STARTS, FRAMES = 6, 25
"""The panel goes along with the wall's world at first, and then its own way."""
PANEL = slice(35, 205)
PANEL_WIDTH = 210


def texture(width, cell_px, seed):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 226, (HEIGHT // cell_px, width // cell_px + 1), dtype=np.uint8)
    return cv2.resize(coarse, (width, HEIGHT), interpolation=cv2.INTER_CUBIC)


def panel_px(i):
    """Left edge of the panel in the left image."""
    at_rest = WALL_STEP_PX * NEAR_PX // FAR_PX  # a frame
    return 85 - at_rest * min(i, STARTS) - PANEL_STEP_PX * max(i - STARTS, 0)


@pytest.fixture(scope="module")
def frames():
    """The camera moves to the right all the time; so, faster, does the panel after a while."""
    wall, panel = texture(WIDTH + 200, 6, 1), texture(PANEL_WIDTH, 6, 2)
    shown = []
    for i in range(FRAMES):
        images = []
        for far_px, near_px in ((0, 0), (FAR_PX, NEAR_PX)):
            start = WALL_STEP_PX * i + far_px
            image = wall[:, start : start + WIDTH].copy()
            left = panel_px(i) - near_px
            first, last = max(left, 0), min(left + PANEL_WIDTH, WIDTH)
            image[PANEL, first:last] = panel[PANEL, first - left : last - left]
            images.append(image)
        shown.append(StereoFrame(10**8 * i, *images))
    return shown


def follow(frames, prior):
    """Estimated way along x (F,), metres, share of matches on the panel at the turn, statuses."""
    sharp = {"defocus": {"softness": 0}}  # the texture is coarse, not out of focus
    settings = OdometrySettings.model_validate({"motion": {"landmark_prior": prior}} | sharp)
    odometry = StereoOdometry(RIG, settings)
    estimates = [odometry.track(frame) for frame in frames]
    statuses = {x.status for x in estimates}
    assert statuses <= {Status.START, Status.TRACKED, Status.WEAK}
    seen = estimates[STARTS].observations
    panel = (seen.disparity_px > (FAR_PX + NEAR_PX) / 2).mean()
    return np.array([x.T_odom_cam[0, 3] for x in estimates]), panel, statuses


def test_landmark_prior_prefers_the_static_world(frames):
    along_m, panel, _ = follow(frames, prior=True)
    assert panel > 0.55
    assert np.abs(along_m - STEP_M * np.arange(FRAMES)).max() < 0.01


def test_without_landmark_prior_the_panel_wins(frames):
    """The recording above is hard: the pose errs, and some frame is weak."""
    along_m, _, statuses = follow(frames, prior=False)
    assert Status.WEAK in statuses
    assert np.abs(along_m - STEP_M * np.arange(FRAMES)).max() > 0.1
