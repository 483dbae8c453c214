"""Keyframes by flow, by remaining information and by few inliers; how long a lost map is kept."""

from dataclasses import replace

import numpy as np
import pytest

from vo.config import MotionSettings, OdometrySettings
from vo.contract.observations import Observations
from vo.map.frame import Matches
from vo.map.local_map import Keyframe, Landmarks, empty_map
from vo.mapping.relocalization import LIMITS, mark_lost
from vo.tracking.new_view import is_new_view

PATIENCE = 5
SETTINGS = OdometrySettings()
MIN_VIEWS = LIMITS.min_views


def _keyframe(count: int) -> Keyframe:
    rng = np.random.default_rng(0)
    u, v, disparity_px = rng.uniform([20, 20, 5], [620, 460, 30], (count, 3)).T
    observations = Observations(np.arange(count), np.column_stack([u, v]), disparity_px)
    left = np.zeros((480, 640), np.uint8)
    return Keyframe(left, observations, 0, np.eye(4), np.zeros((6, 6)))


def _matches(keyframe: Keyframe, count: int, flow_px: float) -> Matches:
    seen = keyframe.observations.select(np.arange(count))
    return Matches(
        ids=seen.ids,
        pixels=seen.pixels + np.array([flow_px, 0]),
        disparity_px=seen.disparity_px,
        rows=seen.ids,
        points_odom=np.ones((count, 3)),
        features=seen.ids,
        zncc=np.ones(count),
    )


def is_new(keyframe: Keyframe, matches: Matches, settings: OdometrySettings) -> bool:
    return is_new_view(keyframe.observations, matches, settings)


@pytest.mark.parametrize(
    ("count", "flow_px", "new"), [(24, 3.0, True), (26, 3.0, False), (24, 0.5, False)]
)
def test_keyframe_few_inliers_and_motion_suffice(count, flow_px, new) -> None:
    keyframe = _keyframe(40)
    matches = _matches(keyframe, count, flow_px)
    assert SETTINGS.motion.weak_inliers == 25
    assert is_new(keyframe, matches, SETTINGS) == new
    lenient = SETTINGS.model_copy(update={"motion": MotionSettings(weak_inliers=3)})
    assert not is_new(keyframe, matches, lenient)


@pytest.mark.parametrize(
    ("count", "flow_px", "new"), [(40, 20.0, False), (40, 31.0, True), (24, 3.0, True)]
)
def test_keyframe_waits_for_the_work_of_the_last_one(count, flow_px, new) -> None:
    """Unless the view changes fast, or hardly a landmark is left."""
    keyframe = _keyframe(40)
    matches = _matches(keyframe, count, flow_px)
    assert is_new(keyframe, matches, SETTINGS)
    assert is_new_view(keyframe.observations, matches, SETTINGS, waits=True) == new


def test_keyframe_is_new_when_near_landmarks_have_left() -> None:
    """However many far ones stay."""
    keyframe = _keyframe(200)
    keyframe.observations.disparity_px[:] = np.where(np.arange(200) < 160, 4.0, 40.0)
    everything, far = _matches(keyframe, 200, 3.0), _matches(keyframe, 160, 3.0)
    assert not is_new(keyframe, everything, SETTINGS)
    assert is_new(keyframe, far, SETTINGS)
    near = everything.select(np.arange(160, 200))
    assert not is_new(keyframe, near, SETTINGS)


@pytest.mark.parametrize("views", [1, MIN_VIEWS - 1, MIN_VIEWS, PATIENCE, 10 * PATIENCE])
def test_mark_lost_keeps_a_map_for_its_views(views: int) -> None:
    n = 20
    landmarks = Landmarks(
        np.arange(n), np.ones((n, 3)), np.zeros((n, 3)), np.zeros((n, 9)), np.full(n, views),
        np.zeros(n, np.int64), np.ones((n, 2)), np.ones(n), np.zeros((n, 2)),
    )  # fmt: skip
    local_map = replace(empty_map(1, n), keyframes=(_keyframe(n),), landmarks=landmarks)
    lost_map, waited = None, 0
    while local_map.keyframes:
        waited += 1
        local_map, lost_map = mark_lost(local_map, lost_map, waited, PATIENCE)
    confirmed = views >= MIN_VIEWS
    assert waited == (min(PATIENCE, views) + 1 if confirmed else 1)
    assert (lost_map is not None) == confirmed
