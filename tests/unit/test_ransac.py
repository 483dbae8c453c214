"""RANSAC on the smallest model there is: where a cloud of points lies."""

import numpy as np
import pytest

from vo.config import MotionSettings
from vo.contract import se3
from vo.ransac import ransac, trials_needed

NOISE_M = 0.01
SETTINGS = MotionSettings(threshold=0.06, confidence=0.9999, most_trials=2000, batch=20)
PLACE = np.array([3.0, -1.0, 0.5])


def cloud(count, share, seed=0):
    """Points at PLACE with noise, the rest anywhere within 10 m; and which are which."""
    rng = np.random.default_rng(seed)
    good = np.arange(count) < round(share * count)
    near = PLACE + rng.normal(scale=NOISE_M, size=(count, 3))
    return np.where(good[:, None], near, rng.uniform(-10, 10, (count, 3))), good


def at(places):
    return se3.pose(np.eye(3), places)


def consensus_on(points, settings=SETTINGS, seed=0, solve=None):
    def mean_place(samples):
        return at(points[samples].mean(axis=1))

    def distance(models):
        return np.linalg.norm(models[:, None, :3, 3] - points, axis=-1)

    rng = np.random.default_rng(seed)
    return ransac(len(points), solve or mean_place, distance, settings, rng)


@pytest.mark.parametrize(
    ("p_good", "confidence", "trials"),
    [
        (0.5, 0.99, 35),  # log 0.01 / log 0.875 = 34.49
        (0.9, 0.9999, 8),  # log 0.0001 / log 0.271 = 7.05
        (0.1, 0.95, 2995),  # log 0.05 / log 0.999 = 2994.2
        (1.0, 0.9999, 1),
    ],
)
def test_trials_needed(p_good, confidence, trials):
    assert trials_needed(p_good, confidence) == trials


def test_trials_needed_without_hope():
    assert trials_needed(0.0, 0.9) > 10**9
    assert trials_needed(1e-7, 0.9) > 10**9


def test_trials_needed_keep_their_promise():
    """Of many runs of that length, the stated share draws a sample of three good ones."""
    p_good, confidence = 0.4, 0.9
    trials = trials_needed(p_good, confidence)
    draws = np.random.default_rng(0).random((20_000, trials, 3)) < p_good
    hit = draws.all(axis=2).any(axis=1).mean()
    assert confidence - 0.01 < hit < confidence + 0.02


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 1.0])
def test_finds_the_model_among_outliers(share):
    points, good = cloud(100, share)
    found = consensus_on(points)
    assert 0 < np.linalg.norm(found.T[:3, 3] - PLACE) < 3 * NOISE_M
    np.testing.assert_array_equal(found.inliers, good)


def test_inliers_are_exactly_those_within_the_threshold():
    points, _ = cloud(200, 0.6)
    found = consensus_on(points, SETTINGS.model_copy(update={"threshold": 1.5 * NOISE_M}))
    distance = np.linalg.norm(points - found.T[:3, 3], axis=1)
    np.testing.assert_array_equal(found.inliers, distance < 1.5 * NOISE_M)
    assert 20 < found.inliers.sum() < 120


def test_more_inliers_beat_a_better_fit():
    """Five points in one spot against six that are spread: the six win; among equals, the fit."""
    tight, loose = np.zeros((5, 3)), np.full((6, 3), 5.0)
    loose += np.random.default_rng(0).uniform(-0.02, 0.02, loose.shape)
    assert consensus_on(np.concatenate([tight, loose])).T[0, 3] > 4
    assert consensus_on(np.concatenate([tight, loose[:5]])).T[0, 3] == 0


def test_trials_adapt_to_the_inliers():
    easy, medium, hopeless = (consensus_on(cloud(100, x)[0]).trials for x in (1.0, 0.5, 0.03))
    assert easy == SETTINGS.batch
    needed = trials_needed(0.5, SETTINGS.confidence)
    assert needed <= medium < needed + 2 * SETTINGS.batch
    assert hopeless == SETTINGS.most_trials


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_data_say_nothing(count):
    assert consensus_on(np.zeros((count, 3))) is None


def test_three_data_are_enough():
    found = consensus_on(np.zeros((3, 3)))
    assert found.inliers.all()


def test_no_model_from_any_sample():
    seen = []

    def barren(samples):
        seen.append(len(samples))
        return np.zeros((0, 4, 4))

    assert consensus_on(np.zeros((10, 3)), solve=barren) is None
    assert sum(seen) == SETTINGS.most_trials


def test_undefined_residuals_are_outliers():
    points, good = cloud(60, 0.5)
    points[~good] = np.nan

    def first(samples):
        return at(points[samples[:, 0]])

    found = consensus_on(points, solve=first)
    np.testing.assert_array_equal(found.inliers, good)


def test_samples_are_of_distinct_data_and_reach_all():
    drawn = []

    def remember(samples):
        drawn.append(samples)
        return np.zeros((0, 4, 4))

    consensus_on(np.zeros((9, 3)), solve=remember)
    samples = np.sort(np.concatenate(drawn), axis=1)
    assert (np.diff(samples, axis=1) > 0).all()
    share = np.bincount(samples.ravel(), minlength=9) / samples.size
    assert np.abs(share - 1 / 9).max() < 0.02


def test_same_seed_same_consensus():
    points, _ = cloud(100, 0.4)
    a, b, other = (consensus_on(points, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.T, b.T)
    np.testing.assert_array_equal(a.inliers, b.inliers)
    assert a.trials == b.trials
    assert (a.T != other.T).any()
