"""The alternatives of refinement against GTSAM's own stereo factors and against known noise."""

import numpy as np
import pytest
from passage import RIG, SIGMA, Passage, gtsam_bundle

from vo.bundle_adjustment.adjust import refine_structure
from vo.bundle_adjustment.fixed_lag import FixedLag
from vo.bundle_adjustment.problem import DENSE_CAMERAS, collect
from vo.config import OdometrySettings, RefinementSettings
from vo.contract import se3
from vo.map.run_history import History
from vo.mapping.batch_smoothing import refine_all
from vo.mapping.window_adjustment import refine_map

PLAIN = RefinementSettings(huber=1e6, max_iterations=50, learn_noise=False)


def settings(**changes):
    return OdometrySettings(refinement=PLAIN.model_copy(update=changes))


def seen_twice(sights):
    ids, times = np.unique(np.concatenate([s.ids for s in sights]), return_counts=True)
    return ids[times >= 2]


def whole_bundle(passage, seed=0):
    sights = passage.started(np.random.default_rng(seed))
    ids = seen_twice(sights)
    fixed = np.arange(len(sights)) == 0
    return collect(sights, ids, passage.points[ids], fixed, RIG)


def error(T_a, T_b):
    return np.abs(se3.log(se3.inverse(T_a) @ T_b)).max()


@pytest.mark.parametrize("keyframes", [5, DENSE_CAMERAS + 10], ids=["one block", "many blocks"])
def test_structure_equals_gtsam_stereo_factors(keyframes):
    """Poses, points and covariances, however the bundle is cut."""
    bundle = whole_bundle(Passage(1, keyframes, fresh=12))
    T, points, covariance = gtsam_bundle(bundle)
    refined = refine_structure(bundle, PLAIN)
    assert error(bundle.T_world_cam, T) > 5e-3
    assert error(refined.T_world_cam, T) < 2e-4
    assert np.median(np.abs(refined.points_world - points)) < 2e-4
    own = np.sqrt(np.diagonal(refined.covariance[1:], axis1=1, axis2=2))
    np.testing.assert_allclose(
        own, np.sqrt(np.diagonal(covariance[1:], axis1=1, axis2=2)), rtol=0.02
    )


def follow(passage, lag):
    """Feed keyframe after keyframe: the last update's poses and covariances."""
    start = passage.sights
    smoother = FixedLag(0, start[0].T_world_cam, np.zeros((6, 6)), lag)
    T = {0: start[0].T_world_cam}
    found = None
    for k in range(1, len(start)):
        T[k] = T[k - 1] @ se3.inverse(start[k - 1].T_world_cam) @ start[k].T_world_cam
        lasting = range(max(0, k - lag + 1), k + 1)
        sights = {
            i: type(start[i])(T[i], start[i].ids, start[i].measured, start[i].sigma)
            for i in lasting
        }
        ids = seen_twice(sights.values())
        found = smoother.update(sights, ids, passage.points[ids], RIG, PLAIN)
        T |= dict(zip(lasting, found.T_odom_cam, strict=True))
    return found


def test_incremental_equals_batch_while_nothing_has_left():
    passage = Passage(2, 6)
    found = follow(passage, lag=6)
    ids = seen_twice(passage.sights)
    bundle = collect(passage.sights, ids, passage.points[ids], np.arange(6) == 0, RIG)
    T, _, covariance = gtsam_bundle(bundle)
    assert error(found.T_odom_cam, T) < 1e-4
    np.testing.assert_allclose(np.diag(found.covariance[-1]), np.diag(covariance[-1]), rtol=0.02)


def test_what_keyframes_leave_behind_is_used_once():
    """After twelve keyframes with a lag of four, errors are as large as the covariance says.

    Larger would mean that a measurement is in the prior twice, smaller that one is lost that the
    covariance counts.
    """
    worlds, values = 40, []
    for seed in range(worlds):
        passage = Passage(seed, 12, fresh=15)
        found = follow(passage, lag=4)
        e = se3.log(se3.inverse(passage.T_odom_cam[-1]) @ found.T_odom_cam[-1])
        values.append(e @ np.linalg.solve(found.covariance[-1], e))
    # Means of 40 chi-squared with 6 degrees deviate by sqrt(12 / 40) = 0.55.
    assert 6 - 3 * 0.55 < np.mean(values) < 6 + 3 * 0.55


@pytest.mark.parametrize("mode", ["window", "fixed_lag"])
def test_modes_correct_poses(mode):
    passage = Passage(3, 2)
    start = passage.local_map(passage.started(np.random.default_rng(3), error=0.02))
    refined, iterations = refine_map(start, RIG, settings(mode=mode, min_views=2))
    before, after = (
        error(m.keyframes[1].T_odom_cam, passage.T_odom_cam[1]) for m in (start, refined)
    )
    assert iterations > 0
    assert 1e-5 < after < before / 3
    assert refined.keyframes[1].covariance.any()
    assert (refined.lag is not None) == (mode == "fixed_lag")


def test_motion_only_leaves_everything_where_it_was():
    passage = Passage(3, 4)
    start = passage.local_map(passage.started(np.random.default_rng(3)))
    assert refine_map(start, RIG, settings(mode="motion")) == (start, 0)


def test_a_smoother_without_landmarks_starts_anew():
    passage = Passage(4, 3)
    start = passage.local_map(passage.sights)
    refined, _ = refine_map(start, RIG, settings(mode="fixed_lag", min_views=2))
    assert refined.lag
    lonely, iterations = refine_map(refined, RIG, settings(mode="fixed_lag", min_views=99))
    assert (lonely.lag, iterations) == (None, 0)
    assert refined.moved(np.eye(4), np.zeros((6, 6))).lag is None


def depth_ratios(passage, refined, ids):
    """Depth over true depth, in the first camera."""
    rows = np.searchsorted(refined.landmarks.ids, ids)
    T = se3.inverse(refined.keyframes[0].T_odom_cam)
    found = se3.transform(T, refined.landmarks.points_odom[rows])[:, 2]
    true = se3.transform(se3.inverse(passage.T_odom_cam[0]), passage.points[ids])[:, 2]
    return found / true


def test_two_views_by_one_eye_collapse_structure_and_disparities_prevent_it():
    """Thesis 4.4: short steps forward, points that two frames saw, and the left eye alone."""
    short = se3.exp(np.array([0.0, 0.0, 0.005, 0.0, 0.0, 0.0]))
    passage = Passage(6, 3, fresh=60, step=short)
    start = passage.local_map(passage.sights)
    twice = seen_twice(passage.sights)
    one_eye = {"use_disparity": False, "min_views": 2}
    collapsed, _ = refine_map(start, RIG, settings(**one_eye))
    ratios = depth_ratios(passage, collapsed, twice)
    assert np.mean((ratios < 0.5) | (ratios > 2)) > 0.2
    kept, _ = refine_map(start, RIG, settings(**one_eye | {"use_disparity": True}))
    ratios = depth_ratios(passage, kept, twice)
    assert np.mean((ratios < 0.5) | (ratios > 2)) < 0.02


def history_of(passage, sights):
    history = History()
    local_map = passage.local_map(sights)
    for keyframe, sight in zip(local_map.keyframes, sights, strict=True):
        history.keyframes[keyframe.serial] = keyframe.T_odom_cam
        history.sights[keyframe.serial] = sight
    for landmark, point in zip(
        local_map.landmarks.ids, local_map.landmarks.points_odom, strict=True
    ):
        history.places[int(landmark)] = point
        history.traits[int(landmark)] = (0, 3, 0)
    return history


def test_global_refinement_of_a_run_equals_gtsam():
    passage = Passage(7, DENSE_CAMERAS + 8, fresh=12)
    bundle = whole_bundle(passage, 7)
    history = history_of(passage, passage.started(np.random.default_rng(7)))
    before = {serial: T.copy() for serial, T in history.keyframes.items()}
    found = refine_all(history, RIG, PLAIN)
    T, points, _ = gtsam_bundle(bundle)
    assert error(np.stack(list(found.keyframes.values())), T) < 2e-4
    ids = seen_twice(passage.sights)
    assert np.median(np.abs(found.positions(ids) - points)) < 2e-4
    assert all((history.keyframes[serial] == before[serial]).all() for serial in before)


def test_groups_that_share_nothing_hang_on_each_other_rigidly():
    passage = Passage(8, 10, fresh=20)
    sights = passage.started(np.random.default_rng(8))
    cut = 1_000
    sights[5:] = [type(s)(s.T_world_cam, s.ids + cut, s.measured, s.sigma) for s in sights[5:]]
    history = history_of(passage, sights)
    found = refine_all(history, RIG, PLAIN).keyframes

    def bridge(T):
        return se3.inverse(T[4]) @ T[5]

    np.testing.assert_allclose(bridge(found), bridge(history.keyframes), atol=1e-9)
    for group in (range(5), range(5, 10)):
        steps = [se3.inverse(found[i]) @ found[i + 1] for i in group[:-1]]
        true = se3.inverse(passage.T_odom_cam[0]) @ passage.T_odom_cam[1]
        assert error(np.array(steps), true) < 5e-3
    assert error(found[4], history.keyframes[4]) > 1e-3


def test_noise_of_the_world_is_what_the_tests_say():
    """The bounds above rest on it."""
    passage = Passage(9, 8, fresh=200)
    residuals = [
        (RIG.project(se3.transform(se3.inverse(T), passage.points[s.ids])) - s.measured) / SIGMA
        for T, s in zip(passage.T_odom_cam, passage.sights, strict=True)
    ]
    assert np.concatenate(residuals).std() == pytest.approx(1.0, abs=0.03)
