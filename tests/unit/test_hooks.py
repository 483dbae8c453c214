"""What comes back from hooks takes the place of what a stage found, and fits with the rest."""

import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, F_PX, HEIGHT, WIDTH, wall

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import UNTOUCHED, Hooks
from vo.map.frame import look
from vo.map.local_map import empty_map
from vo.mapping.keyframes import add_keyframe
from vo.stereo.dense import DenseStereo
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import find_matches
from vo.tracking.replacement import (
    UNKNOWN,
    replace_disparities,
    replace_features,
    replace_inliers,
    replace_matches,
)

STEP_PX = 4
RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)
SETTINGS = OdometrySettings()


class Answer(Hooks):
    """Gives one answer to everything, or applies a function; remembers what it was asked."""

    def __init__(self, answer):
        self.answer = answer

    def _say(self, *asked):
        self.asked = asked
        return self.answer(asked[-1].copy()) if callable(self.answer) else self.answer

    def features(self, frame, pixels):
        return self._say(frame, pixels)

    def pixels(self, frame, ids, pixels):
        return self._say(frame, ids, pixels)


class Depth(Hooks):
    def __init__(self, answer):
        self.answer = answer

    def disparity(self, frame, pixels, disparity_px):
        return self.answer(disparity_px.copy())


@pytest.fixture(scope="module")
def views():
    dense = DenseStereo(SETTINGS.stereo)
    frames = [StereoFrame(i, *pair) for i, pair in enumerate(wall(2, STEP_PX))]
    return [look(frame, dense, SETTINGS, Clock()) for frame in frames]


@pytest.fixture(scope="module")
def local_map(views):
    covariance = np.zeros((6, 6))
    return add_keyframe(empty_map(), views[0], np.eye(4), covariance, None, RIG, SETTINGS)


@pytest.fixture(scope="module")
def matches(views, local_map):
    found = find_matches(local_map, views[1], np.eye(4), 24.0, RIG, SETTINGS)
    assert 20 < len(found) < len(local_map.landmarks)
    return found


def replaced(hooks, matches, local_map, views):
    return replace_matches(hooks, matches, local_map, views[1], SETTINGS)


def assert_same(a, b):
    for name, values in vars(a).items():
        np.testing.assert_array_equal(values, getattr(b, name), err_msg=name)


@pytest.mark.parametrize("hooks", [UNTOUCHED, Hooks()])
def test_by_default_nothing_changes(hooks, matches, local_map, views):
    assert_same(matches, replaced(hooks, matches, local_map, views))
    view = replace_features(hooks, views[0], SETTINGS)
    assert_same(view.features, views[0].features)
    np.testing.assert_array_equal(view.vectors, views[0].vectors)
    pixels = view.features.pixels
    found = measure_disparities(view.frame, view.dense, pixels, SETTINGS.stereo)
    assert_same(found, replace_disparities(hooks, view.frame, pixels, found, SETTINGS.stereo))


def test_hooks_are_asked_about_every_landmark(matches, local_map, views):
    hooks = Answer(lambda pixels: pixels)
    replaced(hooks, matches, local_map, views)
    frame, ids, pixels = hooks.asked
    assert frame is views[1].frame
    np.testing.assert_array_equal(ids, local_map.landmarks.ids)
    np.testing.assert_array_equal(~np.isnan(pixels[:, 0]), np.isin(ids, matches.ids))
    np.testing.assert_array_equal(pixels[matches.rows], matches.pixels)


def test_a_landmark_that_was_not_found_is_matched(matches, local_map, views):
    """The wall moves by STEP_PX: where every landmark is, and its disparity, are known."""
    true = local_map.landmarks.anchor_pixels - [STEP_PX, 0]
    true[true[:, 0] < 30] = np.nan
    found = replaced(Answer(true), matches, local_map, views)
    expected = np.flatnonzero(~np.isnan(true[:, 0]))
    np.testing.assert_array_equal(found.rows, expected)
    np.testing.assert_array_equal(found.ids, local_map.landmarks.ids[expected])
    np.testing.assert_array_equal(found.points_odom, local_map.landmarks.points_odom[expected])
    np.testing.assert_array_equal(found.pixels, true[expected])
    known = ~np.isnan(found.measured[:, 2])
    assert known.mean() > 0.8
    assert np.median(np.abs(found.measured[known, 2] - DISPARITY_PX)) < 0.05
    np.testing.assert_array_equal(np.isnan(found.sigma), np.isnan(found.measured))
    assert (found.features == UNKNOWN).all()


def test_matches_that_are_refused_are_gone(matches, local_map, views):
    def refuse(pixels):
        pixels[matches.rows[::2]] = np.nan
        return pixels

    odd = np.arange(len(matches)) % 2 == 1
    assert_same(replaced(Answer(refuse), matches, local_map, views), matches.select(odd))


def test_disparities_of_matches(matches, local_map, views):
    found = replaced(Depth(lambda d: np.full_like(d, 7.5)), matches, local_map, views)
    np.testing.assert_array_equal(found.measured[:, 2], 7.5)
    np.testing.assert_array_equal(found.pixels, matches.pixels)
    assert (found.sigma > 0).all()
    beyond = np.nextafter(SETTINGS.stereo.min_disparity_px, -1)
    found = replaced(Depth(lambda d: np.full_like(d, beyond)), matches, local_map, views)
    assert np.isnan(found.measured[:, 2]).all()
    assert np.isnan(found.sigma[:, 2]).all()


def test_without_features_landmarks_can_still_be_matched(views, local_map):
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    view = look(StereoFrame(5, blank, blank), DenseStereo(SETTINGS.stereo), SETTINGS, Clock())
    none = find_matches(local_map, view, np.eye(4), 24.0, RIG, SETTINGS)
    hooks = Answer(local_map.landmarks.anchor_pixels)
    found = replace_matches(hooks, none, local_map, view, SETTINGS)
    assert len(none) == 0
    np.testing.assert_array_equal(found.pixels, local_map.landmarks.anchor_pixels)
    assert np.isnan(found.measured[:, 2]).all()


def test_features_are_described_where_they_are_put(views):
    pixels = views[0].features.pixels[[3, 1]] + [[0, 0], [0.2, 0]]
    view = replace_features(Answer(pixels), views[0], SETTINGS)
    np.testing.assert_array_equal(view.features.pixels, pixels)
    np.testing.assert_array_equal(view.vectors[0], views[0].vectors[3])
    assert len(replace_features(Answer(pixels[:0]), views[0], SETTINGS).vectors) == 0


def test_inliers_can_be_turned_round(matches, views):
    class Contrary(Hooks):
        def inliers(self, frame, ids, pixels, agree):
            assert frame is views[1].frame
            np.testing.assert_array_equal(pixels, matches.pixels)
            return ~agree

    odd = np.arange(len(matches)) % 2 == 1
    agreed = matches.select(odd)
    assert_same(replace_inliers(Hooks(), views[1], matches, agreed), agreed)
    assert_same(replace_inliers(UNTOUCHED, views[1], matches, agreed), agreed)
    assert_same(replace_inliers(Contrary(), views[1], matches, agreed), matches.select(~odd))


def test_disparities_of_features(views):
    view, s = views[0], SETTINGS.stereo
    pixels = np.array([[60.0, 60.0], [2.0, 2.0], [90.0, 40.0]])
    found = measure_disparities(view.frame, view.dense, pixels, s)
    assert np.isnan(found.values_px[1])
    answers = np.array([3.0, 4.0, np.nan])
    put = replace_disparities(Depth(lambda _: answers), view.frame, pixels, found, s)
    np.testing.assert_array_equal(put.values_px, answers)
    assert put.sigma_px[0] == found.sigma_px[0]
    assert put.sigma_px[1] > 0
    assert np.isnan(put.sigma_px[2])
