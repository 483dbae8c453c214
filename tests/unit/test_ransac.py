"""RANSAC's own promises: trials, samples, scores and seeds."""

import numpy as np
import pytest

from vo.config import MotionSettings
from vo.contract import se3
from vo.pose.hypotheses import Problem, cost, inliers, misfits
from vo.pose.p3p import SOLVERS
from vo.pose.ransac import _choose, _marks, ransac, trials_needed

T_ODOM_CAM = se3.exp(np.array([0.3, -0.1, 0.2, 0.05, -0.1, 0.02]))
THRESHOLD = 0.003
SETTINGS = MotionSettings(max_hypotheses=2000)


def problem(count, share, noise=0.0, seed=0, inlier_cost=1.0):
    """A view of landmarks 1 to 6 m away; the first `share` are seen right, the others anywhere."""
    rng = np.random.default_rng(seed)
    rays, depth_m = rng.uniform(-0.6, 0.6, (count, 2)), rng.uniform(1, 6, (count, 1))
    points_cam = depth_m * np.append(rays, np.ones((count, 1)), axis=1)
    good = np.arange(count) < round(share * count)
    seen = rays + rng.normal(scale=noise, size=rays.shape)
    seen[~good] = rng.uniform(-0.6, 0.6, ((~good).sum(), 2))
    points_odom = se3.transform(T_ODOM_CAM, points_cam)
    given = points_odom, seen, points_cam, False, SOLVERS["lambda_twist"], False, THRESHOLD
    return Problem(*given, inlier_cost, np.ones(count)), good


def consensus_on(matches, seed=0, **settings):
    return ransac(matches, SETTINGS.model_copy(update=settings), np.random.default_rng(seed))


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
    trials = int(trials_needed(p_good, confidence))
    draws = np.random.default_rng(0).random((20_000, trials, 3)) < p_good
    hit = draws.all(axis=2).any(axis=1).mean()
    assert confidence - 0.01 < hit < confidence + 0.02


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 1.0])
def test_finds_the_pose_among_outliers(share, scheme):
    matches, good = problem(200, share)
    found = consensus_on(matches, scheme=scheme)
    np.testing.assert_allclose(found.T, T_ODOM_CAM, atol=1e-9)
    assert found.inliers[good].all()
    assert found.inliers[~good].mean() < 0.02 if share < 1 else found.inliers.all()


def test_trials_adapt_to_the_inliers():
    easy, medium, hopeless = (
        consensus_on(problem(200, share)[0]).trials for share in (1.0, 0.5, 0.02)
    )
    assert easy == 1
    needed = trials_needed(0.5, SETTINGS.confidence)
    assert 0.7 * needed < medium <= needed
    assert hopeless == SETTINGS.max_hypotheses


@pytest.mark.parametrize("local_iterations", [0, 4])
def test_inliers_are_exactly_those_within_the_threshold(local_iterations):
    matches, _ = problem(300, 0.7, noise=0.002)
    found = consensus_on(matches, local_iterations=local_iterations)
    points_cam = se3.transform(se3.inverse(found.T), matches.points_odom)
    errors = np.linalg.norm(points_cam[:, :2] / points_cam[:, 2:] - matches.rays, axis=1)
    np.testing.assert_array_equal(found.inliers, errors < THRESHOLD)
    assert 100 < found.inliers.sum() < 200


def two_views(tight, spread):
    """Landmarks seen from the origin by some matches, and from 2 m aside by others, with noise."""
    rng = np.random.default_rng(1)
    count = tight + spread
    points = rng.uniform([-2, -2, 3], [2, 2, 6], (count, 3))
    aside = np.where(np.arange(count) < tight, 0.0, 2.0)[:, None] * [1, 0, 0]
    rays = (points - aside)[:, :2] / (points - aside)[:, 2:]
    rays[tight:] += rng.uniform(-0.0015, 0.0015, (spread, 2))
    return points, rays


@pytest.mark.parametrize(
    ("tight", "spread", "x_inliers", "x_msac"), [(30, 33, 2, 0), (30, 60, 2, 2), (30, 30, 0, 0)]
)
def test_a_count_prefers_more_and_msac_better(tight, spread, x_inliers, x_msac):
    """A few inliers more win the count; to MSAC their misfit costs more than that."""
    points, rays = two_views(tight, spread)
    given = points, rays, points, False, SOLVERS["lambda_twist"], False, THRESHOLD
    equal = np.ones(len(points))
    by_count = Problem(*given, inlier_cost=0.999 / len(points), weights=equal)
    by_msac = Problem(*given, inlier_cost=1.0, weights=equal)
    assert consensus_on(by_count).T[0, 3] == pytest.approx(x_inliers, abs=0.01)
    assert consensus_on(by_msac).T[0, 3] == pytest.approx(x_msac, abs=0.01)


def test_cost_by_hand():
    """One match exact, one at half the threshold, one beyond it, one behind the camera."""
    points = np.array([[0.0, 0, 2], [1, 1, 2], [0, 1, 2], [0, 0, -2]])
    rays = np.array([[0.0, 0], [0.5 + THRESHOLD / 2, 0.5], [0, 0.6], [0, 0]])
    pose = np.eye(3, 4)
    matches = Problem(points, rays, points, False, 0, False, THRESHOLD, 1.0, np.ones(4))
    errors = np.empty(4)
    misfits(matches, pose, 0, 4, errors)
    np.testing.assert_allclose(errors, [0, 0.25, (0.1 / THRESHOLD) ** 2, np.inf], atol=1e-12)
    assert cost(matches, pose, 0, 4, np.inf) == pytest.approx(2.25)
    assert cost(matches, pose, 1, 3, np.inf) == pytest.approx(1.25)
    assert cost(matches, pose, 0, 4, 2.24) == np.inf
    assert cost(matches._replace(inlier_cost=0.1), pose, 0, 4, np.inf) == pytest.approx(2.025)
    weighted = matches._replace(weights=np.array([1, 4, 2, 0.0]))
    assert cost(weighted, pose, 0, 4, np.inf) == pytest.approx(4 * 0.25 + 2)
    np.testing.assert_array_equal(inliers(matches, pose), [0, 1])
    metric = matches._replace(metric=True, points_cam=points + np.array([0, 0, 0.3]), threshold=0.5)
    misfits(metric, pose, 0, 4, errors)
    np.testing.assert_allclose(errors, [0.36, 0.36, 0.36, np.inf])


def test_giving_up_early_changes_nothing():
    """The cost that bails out is the cost that does not, or is above the limit."""
    matches, _ = problem(500, 0.5, noise=0.001)
    rng = np.random.default_rng(2)
    gave_up = 0
    for _ in range(200):
        near = se3.inverse(T_ODOM_CAM @ se3.exp(rng.normal(scale=0.002, size=6)))[:3].copy()
        whole, limit = cost(matches, near, 0, 500, np.inf), rng.uniform(200, 450)
        limited = cost(matches, near, 0, 500, limit)
        assert limited == (whole if whole < limit else np.inf)
        gave_up += np.isinf(limited)
    assert 20 < gave_up < 180


def test_samples_are_of_distinct_matches_and_all_triplets_equally_likely():
    rng = np.random.default_rng(0)
    seen = np.zeros((5, 5, 5))
    sample = np.empty(3, dtype=np.int64)
    draws = 60_000
    for draw in rng.random((draws, 3)):
        _choose(draw, np.arange(6.0), sample)
        seen[tuple(sample)] += 1
    distinct = np.array([len({i, j, k}) == 3 for i, j, k in np.ndindex(5, 5, 5)]).reshape(5, 5, 5)
    assert (seen[~distinct] == 0).all()
    expected = draws / 60
    assert np.abs(seen[distinct] - expected).max() < 4.5 * np.sqrt(expected)


def test_samples_follow_the_weights():
    """Against drawing without replacement by NumPy's generator."""
    weights = np.array([1.0, 0, 2, 3, 4])
    rng = np.random.default_rng(0)
    sample = np.empty(3, dtype=np.int64)
    drawn, expected = np.zeros((2, 5, 3))
    for draw in rng.random((20_000, 3)):
        _choose(draw, _marks(weights), sample)
        assert len(set(sample)) == 3
        drawn[sample, range(3)] += 1
        expected[rng.choice(5, 3, replace=False, p=weights / 10), range(3)] += 1
    assert (drawn[1] == 0).all()
    assert np.abs(drawn - expected).max() < 4.5 * np.sqrt(2 * 20_000 / 4)


def test_the_larger_group_does_not_win_against_weight():
    """Sixty matches agree on one motion, forty that weigh three times as much on another."""
    points, rays = two_views(40, 60)
    given = points, rays, points, False, SOLVERS["lambda_twist"], False, THRESHOLD
    weights = np.where(np.arange(100) < 40, 3.0, 1.0)
    matches = Problem(*given, 1.0, np.ones(100))
    assert consensus_on(matches).T[0, 3] == pytest.approx(2, abs=0.01)
    for scheme in ("adaptive", "preemptive"):
        found = consensus_on(matches._replace(weights=weights), scheme=scheme)
        assert found.T[0, 3] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_fewer_than_three_matches_say_nothing(count, scheme):
    assert consensus_on(problem(count, 1.0)[0], scheme=scheme) is None


def test_three_matches_are_enough_but_tell_no_uncertainty():
    found = consensus_on(problem(3, 1.0)[0])
    assert found.inliers.all()
    assert np.isnan(found.covariance).all()


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_no_pose_from_any_sample(scheme):
    matches, _ = problem(10, 1.0)
    line = np.linspace(1, 2, 10)[:, None] * np.array([[0.2, 0.1, 1.0]]) + [1, 0, 0]
    assert consensus_on(matches._replace(points_odom=line), scheme=scheme) is None


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_same_seed_same_consensus(scheme):
    matches, _ = problem(100, 0.4, noise=0.001)
    a, b, other = (
        consensus_on(matches, seed=seed, scheme=scheme, local_iterations=0) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(a.T, b.T)
    np.testing.assert_array_equal(a.inliers, b.inliers)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert a.trials == b.trials
    assert (a.T != other.T).any()


def test_preemption_draws_its_budget_and_no_more():
    matches, good = problem(300, 0.5, noise=0.0005)
    found = consensus_on(matches, scheme="preemptive", max_hypotheses=100)
    assert found.trials == 100
    assert found.inliers[good].mean() > 0.98
