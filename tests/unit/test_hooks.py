"""Answers of hooks replace the output of a stage, consistently with the rest."""

import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, F_PX, HEIGHT, WIDTH, wall

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import NO_FEATURE
from vo.map.local_map import empty_map
from vo.mapping.keyframes import add_keyframe
from vo.odometry import StereoOdometry
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import find_matches
from vo.tracking.frontend import Frontend
from vo.tracking.hooked import (
    replace_disparities,
    replace_features,
    replace_inliers,
    replace_matches,
)

STEP_PX = 4
RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)
SETTINGS = OdometrySettings()


class Answer(Hooks):
    """Gives one answer to everything, or applies a function; keeps the arguments."""

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


def view_of(frame):
    return Frontend(RIG, SETTINGS).extract(frame, SETTINGS, 0.0, Clock())


@pytest.fixture(scope="module")
def views():
    return [view_of(StereoFrame(i, *pair)) for i, pair in enumerate(wall(2, STEP_PX))]


@pytest.fixture(scope="module")
def local_map(views):
    return add_keyframe(empty_map(), views[0], np.eye(4), np.zeros((6, 6)))


@pytest.fixture(scope="module")
def matches(views, local_map):
    found = find_matches(local_map, views[1], np.eye(4), 24.0)
    assert 20 < len(found) < len(local_map.landmarks)
    return found


def replaced(hooks, matches, local_map, views):
    return replace_matches(hooks, matches, local_map, views[1])


def assert_same(a, b):
    for name, values in vars(a).items():
        np.testing.assert_array_equal(values, getattr(b, name), err_msg=name)


@pytest.mark.parametrize("hooks", [NO_HOOKS, Hooks()])
def test_hooks_by_default_change_nothing(hooks, matches, local_map, views):
    assert_same(matches, replaced(hooks, matches, local_map, views))
    view = views[0]
    pixels = replace_features(hooks, view.frame, view.features)
    np.testing.assert_array_equal(pixels, view.features)
    found = measure_disparities(view.frame, view.dense, pixels, SETTINGS.stereo)
    assert_same(found, replace_disparities(hooks, view.frame, pixels, found, SETTINGS.stereo))


def test_hooks_receive_every_landmark(matches, local_map, views):
    hooks = Answer(lambda pixels: pixels)
    replaced(hooks, matches, local_map, views)
    frame, ids, pixels = hooks.asked
    np.testing.assert_array_equal(frame.left, views[1].frame.left)
    np.testing.assert_array_equal(ids, local_map.landmarks.ids)
    np.testing.assert_array_equal(~np.isnan(pixels[:, 0]), np.isin(ids, matches.ids))
    np.testing.assert_array_equal(pixels[matches.rows], matches.pixels)


def test_hooks_pixels_of_unmatched_landmarks_are_matched(matches, local_map, views):
    """The wall moves by STEP_PX: where every landmark is, and its disparity, are known."""
    true = local_map.landmarks.anchor_pixels - [STEP_PX, 0]
    true[true[:, 0] < 30] = np.nan
    found = replaced(Answer(true), matches, local_map, views)
    expected = np.flatnonzero(~np.isnan(true[:, 0]))
    np.testing.assert_array_equal(found.rows, expected)
    np.testing.assert_array_equal(found.ids, local_map.landmarks.ids[expected])
    np.testing.assert_array_equal(found.points_odom, local_map.landmarks.points_odom[expected])
    np.testing.assert_array_equal(found.pixels, true[expected])
    known = ~np.isnan(found.disparity_px)
    assert known.mean() > 0.8
    assert np.median(np.abs(found.disparity_px[known] - DISPARITY_PX)) < 0.05
    np.testing.assert_array_equal(np.isnan(found.sigma_px), np.isnan(found.measured))
    assert (found.features == NO_FEATURE).all()


def test_hooks_refused_pixels_are_removed(matches, local_map, views):
    def refuse(pixels):
        pixels[matches.rows[::2]] = np.nan
        return pixels

    odd = np.arange(len(matches)) % 2 == 1
    assert_same(replaced(Answer(refuse), matches, local_map, views), matches.select(odd))


def test_hooks_disparities_of_matches_are_gated(matches, local_map, views):
    found = replaced(Depth(lambda d: np.full_like(d, 7.5)), matches, local_map, views)
    np.testing.assert_array_equal(found.disparity_px, 7.5)
    np.testing.assert_array_equal(found.pixels, matches.pixels)
    assert (found.sigma_px > 0).all()
    beyond = np.nextafter(SETTINGS.stereo.min_disparity_px, -1)
    found = replaced(Depth(lambda d: np.full_like(d, beyond)), matches, local_map, views)
    assert np.isnan(found.disparity_px).all()
    assert np.isnan(found.sigma_px[:, 2]).all()


def test_hooks_match_landmarks_without_features(views, local_map):
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    view = view_of(StereoFrame(5, blank, blank))
    none = find_matches(local_map, view, np.eye(4), 24.0)
    hooks = Answer(local_map.landmarks.anchor_pixels)
    found = replace_matches(hooks, none, local_map, view)
    assert len(none) == 0
    np.testing.assert_array_equal(found.pixels, local_map.landmarks.anchor_pixels)
    assert np.isnan(found.disparity_px).all()


@pytest.mark.parametrize("count", [2, 0])
def test_hooks_features_are_described_anew(views, count):
    """They replace what is detected, when it is detected."""
    pixels = (views[0].features[[3, 1]] + [[0, 0], [0.2, 0]])[:count]
    view = Frontend(RIG, SETTINGS).extract(views[0].frame, SETTINGS, 0.0, Clock(), Answer(pixels))
    assert view.detection.counts == {}
    np.testing.assert_array_equal(view.features, pixels)
    assert view.detection.counts == {"features": count}
    assert len(view.descriptors) == count
    np.testing.assert_array_equal(view.descriptors[:1], views[0].descriptors[[3]][:count])


def test_hooks_inliers_can_be_inverted(matches, views):
    class Contrary(Hooks):
        def inliers(self, frame, ids, pixels, agree):
            assert frame.timestamp_ns == views[1].frame.timestamp_ns
            np.testing.assert_array_equal(pixels, matches.pixels)
            return ~agree

    odd = np.arange(len(matches)) % 2 == 1
    agreed = matches.select(odd)
    assert_same(replace_inliers(Hooks(), views[1], matches, agreed), agreed)
    assert_same(replace_inliers(NO_HOOKS, views[1], matches, agreed), agreed)
    assert_same(replace_inliers(Contrary(), views[1], matches, agreed), matches.select(~odd))


def test_hooks_disparities_of_features_have_sigmas(views):
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


class Writing(Hooks):
    """Writes into every argument."""

    def features(self, frame, pixels):
        with pytest.raises(ValueError, match="read-only"):
            frame.left[0, 0] = 0
        return self._spoil(pixels)

    def new_landmarks(self, frame, ids, pixels):
        self._spoil(ids), self._spoil(pixels)

    def predicted_pose(self, frame, last_ns, T_odom_last, T_odom_cam):
        self._spoil(T_odom_last)
        return self._spoil(T_odom_cam)

    def pixels(self, frame, ids, pixels):
        self._spoil(ids)
        return self._spoil(pixels)

    def disparity(self, frame, pixels, disparity_px):
        self._spoil(pixels)
        return self._spoil(disparity_px)

    def inliers(self, frame, ids, pixels, agree):
        self._spoil(pixels)
        return self._spoil(agree)

    def _spoil(self, array):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
        return array


def test_hooks_cannot_write_into_their_arguments():
    frames = [StereoFrame(i, *pair) for i, pair in enumerate(wall(4, STEP_PX))]
    plain, hooked = StereoOdometry(RIG), StereoOdometry(RIG, hooks=Writing())
    for frame in frames:
        a, b = plain.track(frame), hooked.track(frame)
        np.testing.assert_array_equal(a.T_odom_cam, b.T_odom_cam)
        assert b.status is not Status.LOST


def test_hooks_set_on_the_way_keep_the_state():
    """The smoothing after a noisy image, the map and the pose survive."""
    rng = np.random.default_rng(0)
    pairs = list(wall(5, STEP_PX))
    noisy = tuple(np.clip(x + rng.normal(0, 9, x.shape), 0, 255).astype(np.uint8) for x in pairs[0])
    frames = [StereoFrame(i, *pair) for i, pair in enumerate([noisy, *pairs[1:]])]
    plain, exchanged = StereoOdometry(RIG), StereoOdometry(RIG)
    for i, frame in enumerate(frames):
        if i == 2:
            assert exchanged.state.smoothing_px > 0
            exchanged.hooks = Hooks()
        a, b = plain.track(frame), exchanged.track(frame)
        assert exchanged.state.smoothing_px == plain.state.smoothing_px > 0
        assert a.status is b.status
        np.testing.assert_array_equal(a.T_odom_cam, b.T_odom_cam)


def test_hooks_of_former_names_are_refused():
    with pytest.raises(TypeError, match=r"Old\.born: this hook is now new_landmarks"):

        class Old(Hooks):
            def born(self, frame, ids, pixels):
                pass
