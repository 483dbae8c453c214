"""The modes of bundle adjustment against GTSAM's own stereo factors and against known noise."""

from dataclasses import replace

import numpy as np
import pytest
from passage import RIG, SIGMA, Passage, collected, gtsam_bundle

from vo.bundle_adjustment.adjust import refine_structure
from vo.bundle_adjustment.fixed_lag import FixedLag
from vo.config import RefinementSettings
from vo.contract import se3
from vo.map.local_map import transform_map
from vo.map.run_history import KeyframeRecord, RunHistory
from vo.mapping.batch_smoothing import smooth
from vo.mapping.window_adjustment import adjuster

PLAIN = RefinementSettings(huber=1e6, max_iterations=50, learn_noise=False)


def adjustment(mode="window", **changes):
    settings = PLAIN.model_copy(update={"mode": mode, **changes})
    return adjuster(RIG, settings)


def seen_twice(keyframes):
    seen = np.concatenate([k.observations.ids for k in keyframes])
    ids, times = np.unique(seen, return_counts=True)
    return ids[times >= 2]


def whole_bundle(passage, seed=0):
    keyframes = passage.started(np.random.default_rng(seed))
    ids = seen_twice(keyframes)
    return collected(keyframes, ids, passage.points[ids], np.arange(len(keyframes)) == 0)


def error(T_a, T_b):
    return np.abs(se3.log(se3.inverse(T_a) @ T_b)).max()


@pytest.mark.parametrize("keyframes", [5, 34])
def test_window_equals_gtsam_stereo_factors(keyframes):
    """Poses, points and covariances."""
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
    start = passage.keyframes
    smoother = FixedLag(0, start[0].T_odom_cam, np.zeros((6, 6)), lag)
    T = {0: start[0].T_odom_cam}
    found = None
    for k in range(1, len(start)):
        T[k] = T[k - 1] @ se3.inverse(start[k - 1].T_odom_cam) @ start[k].T_odom_cam
        lasting = range(max(0, k - lag + 1), k + 1)
        ids = seen_twice([start[i] for i in lasting])
        poses = {i: T[i] for i in lasting}
        seen = {i: start[i].observations for i in lasting}
        found = smoother.update(poses, seen, ids, passage.points[ids], RIG, PLAIN)
        T |= dict(zip(lasting, found.T_odom_cam, strict=True))
    return found


def test_fixed_lag_equals_batch_while_nothing_has_left():
    passage = Passage(2, 6)
    found = follow(passage, lag=6)
    ids = seen_twice(passage.keyframes)
    bundle = collected(passage.keyframes, ids, passage.points[ids], np.arange(6) == 0)
    T, _, covariance = gtsam_bundle(bundle)
    assert error(found.T_odom_cam, T) < 1e-4
    np.testing.assert_allclose(np.diag(found.covariance[-1]), np.diag(covariance[-1]), rtol=0.02)


def test_fixed_lag_uses_measurements_once():
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
def test_adjustments_correct_poses(mode):
    passage = Passage(3, 2)
    start = passage.local_map(passage.started(np.random.default_rng(3), error=0.02))
    refined, iterations = adjustment(mode, min_views=2)(start)
    before, after = (
        error(m.keyframes[1].T_odom_cam, passage.T_odom_cam[1]) for m in (start, refined)
    )
    assert iterations > 0
    assert 1e-5 < after < before / 3
    assert refined.keyframes[1].covariance.any()


def test_motion_mode_leaves_the_map_as_it_is():
    passage = Passage(3, 4)
    start = passage.local_map(passage.started(np.random.default_rng(3)))
    assert adjustment("motion")(start) == (start, 0)


def test_fixed_lag_starts_anew_without_landmarks_or_map():
    passage = Passage(4, 4)
    adjust = adjustment("fixed_lag", min_views=2)
    refined, iterations = adjust(passage.local_map(passage.keyframes[:3]))
    assert iterations > 0
    first = adjust._smoother
    assert first is not None
    grown = replace(refined, keyframes=(*refined.keyframes, passage.keyframes[3]))
    adjust(grown)
    assert adjust._smoother is first
    elsewhere = transform_map(grown, se3.exp(np.full(6, 0.1)), np.zeros((6, 6)))
    adjust(elsewhere)
    assert adjust._smoother not in (None, first)
    lonely = replace(elsewhere, landmarks=elsewhere.landmarks.update(slice(None), views=0))
    assert adjust(lonely) == (lonely, 0)
    assert adjust._smoother is None


def depth_ratios(passage, refined, ids):
    """Depth over true depth, in the first camera."""
    rows = np.searchsorted(refined.landmarks.ids, ids)
    T = se3.inverse(refined.keyframes[0].T_odom_cam)
    found = se3.transform(T, refined.landmarks.points_odom[rows])[:, 2]
    true = se3.transform(se3.inverse(passage.T_odom_cam[0]), passage.points[ids])[:, 2]
    return found / true


def test_window_two_mono_views_collapse_and_disparity_prevents():
    """Thesis 4.4: short steps forward, points that two frames saw, the left eye: the minimum."""
    short = se3.exp(np.array([0.0, 0.0, 0.005, 0.0, 0.0, 0.0]))
    passage = Passage(6, 3, fresh=60, step=short)
    start = passage.local_map(passage.keyframes)
    twice = seen_twice(passage.keyframes)
    collapsed, _ = adjustment(use_disparity=False, min_views=2, backend="gtsam")(start)
    ratios = depth_ratios(passage, collapsed, twice)
    assert np.mean((ratios < 0.5) | (ratios > 2)) > 0.2
    kept, _ = adjustment(use_disparity=True, min_views=2)(start)
    ratios = depth_ratios(passage, kept, twice)
    assert np.mean((ratios < 0.5) | (ratios > 2)) < 0.02


def history_of(passage, keyframes):
    history = RunHistory()
    local_map = passage.local_map(keyframes)
    for k in keyframes:
        history.keyframes[k.serial] = KeyframeRecord(k.T_odom_cam, k.observations)
    landmarks = replace(local_map.landmarks, views=np.full(len(local_map.landmarks), 3))
    history.record_landmarks(landmarks, np.zeros(len(landmarks), np.uint8))
    return history


def test_smoothing_of_a_run_equals_gtsam():
    passage = Passage(7, 32, fresh=12)
    bundle = whole_bundle(passage, 7)
    history = history_of(passage, passage.started(np.random.default_rng(7)))
    before = {serial: k.T_odom_cam.copy() for serial, k in history.keyframes.items()}
    found = smooth(history, RIG, PLAIN)
    T, points, _ = gtsam_bundle(bundle)
    assert error(np.stack([k.T_odom_cam for k in found.keyframes.values()]), T) < 2e-4
    ids = seen_twice(passage.keyframes)
    assert np.median(np.abs(found.positions(ids) - points)) < 2e-4
    assert all((history.keyframes[serial].T_odom_cam == before[serial]).all() for serial in before)


def test_smoothing_keeps_unconnected_groups_rigid():
    passage = Passage(8, 10, fresh=20)
    keyframes = passage.started(np.random.default_rng(8))
    for i in range(5, 10):
        other = replace(keyframes[i].observations, ids=keyframes[i].observations.ids + 1_000)
        keyframes[i] = replace(keyframes[i], observations=other)
    history = history_of(passage, keyframes)
    known, found = (
        {serial: k.T_odom_cam for serial, k in x.keyframes.items()}
        for x in (history, smooth(history, RIG, PLAIN))
    )

    def bridge(T):
        return se3.inverse(T[4]) @ T[5]

    np.testing.assert_allclose(bridge(found), bridge(known), atol=1e-9)
    for group in (range(5), range(5, 10)):
        steps = [se3.inverse(found[i]) @ found[i + 1] for i in group[:-1]]
        true = se3.inverse(passage.T_odom_cam[0]) @ passage.T_odom_cam[1]
        assert error(np.array(steps), true) < 5e-3
    assert error(found[4], known[4]) > 1e-3


def test_passage_noise_is_as_stated():
    """The bounds above rest on it."""
    passage = Passage(9, 8, fresh=200)
    residuals = [
        (RIG.project(se3.transform(se3.inverse(T), passage.points[x.ids])) - x.measured) / SIGMA
        for T, x in zip(
            passage.T_odom_cam, (k.observations for k in passage.keyframes), strict=True
        )
    ]
    assert np.concatenate(residuals).std() == pytest.approx(1.0, abs=0.03)
