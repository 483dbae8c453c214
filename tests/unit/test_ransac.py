"""RANSAC: number of samples, sampling, scores and seeds."""

import numpy as np
import pytest

from vo.config import MotionSettings
from vo.contract import se3
from vo.pose.hypotheses import (
    Problem,
    cost,
    cumulative_weights,
    draw_sample,
    inlier_rows,
    squared_errors,
)
from vo.pose.p3p import SOLVERS
from vo.pose.ransac import ransac, samples_needed, search_adaptive, search_preemptive

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
    return to_problem(points_odom, seen, points_cam, inlier_cost), good


def to_problem(points_odom, rays, points_cam, inlier_cost=1.0):
    """Matches of weight one, scored by reprojection."""
    return Problem(
        points_odom=points_odom,
        rays=rays,
        points_cam=points_cam,
        absolute=False,
        solver=SOLVERS["lambda_twist"],
        metric=False,
        threshold=THRESHOLD,
        inlier_cost=inlier_cost,
        weights=np.ones(len(rays)),
    )


def consensus_on(matches, seed=0, **settings):
    settings = SETTINGS.model_copy(update=settings)
    return ransac(matches, np.eye(4), settings, np.random.default_rng(seed))


def samples_drawn(matches, search=search_adaptive, most=2000):
    """Number of samples until a search ends."""
    draws = np.random.default_rng(0).random((most, 3))
    return search(matches, draws, SETTINGS.confidence, 4, np.zeros((3, 4)))


@pytest.mark.parametrize(
    ("p_good", "confidence", "samples"),
    [
        (0.5, 0.99, 35),  # log 0.01 / log 0.875 = 34.49
        (0.9, 0.9999, 8),  # log 0.0001 / log 0.271 = 7.05
        (0.1, 0.95, 2995),  # log 0.05 / log 0.999 = 2994.2
        (1.0, 0.9999, 1),
    ],
)
def test_samples_needed_hand_worked(p_good, confidence, samples):
    assert samples_needed(p_good, confidence) == samples


def test_samples_needed_few_inliers_are_very_many():
    assert samples_needed(0.0, 0.9) > 10**9
    assert samples_needed(1e-7, 0.9) > 10**9


def test_samples_needed_reach_stated_confidence():
    """Of many runs of that length, the stated share draws a sample of three good ones."""
    p_good, confidence = 0.4, 0.9
    samples = int(samples_needed(p_good, confidence))
    draws = np.random.default_rng(0).random((20_000, samples, 3)) < p_good
    hit = draws.all(axis=2).any(axis=1).mean()
    assert confidence - 0.01 < hit < confidence + 0.02


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 1.0])
def test_ransac_with_outliers_finds_pose(share, scheme):
    matches, good = problem(200, share)
    found = consensus_on(matches, scheme=scheme)
    np.testing.assert_allclose(found.T_odom_cam, T_ODOM_CAM, atol=1e-9)
    assert found.inliers[good].all()
    assert found.inliers[~good].mean() < 0.02 if share < 1 else found.inliers.all()


def test_search_adapts_samples_to_inliers():
    easy, medium, hopeless = (samples_drawn(problem(200, share)[0]) for share in (1.0, 0.5, 0.02))
    assert easy == 1
    needed = samples_needed(0.5, SETTINGS.confidence)
    assert 0.7 * needed < medium <= needed
    assert hopeless == 2000


@pytest.mark.parametrize("local_iterations", [0, 4])
def test_ransac_inliers_are_within_threshold(local_iterations):
    matches, _ = problem(300, 0.7, noise=0.002)
    found = consensus_on(matches, local_iterations=local_iterations)
    points_cam = se3.transform(se3.inverse(found.T_odom_cam), matches.points_odom)
    errors = np.linalg.norm(points_cam[:, :2] / points_cam[:, 2:] - matches.rays, axis=1)
    np.testing.assert_array_equal(found.inliers, errors < THRESHOLD)
    assert 100 < found.inliers.sum() < 200


def two_views(tight, loose):
    """Landmarks seen from the origin by some matches, and from 2 m aside by others, with noise."""
    rng = np.random.default_rng(1)
    count = tight + loose
    points = rng.uniform([-2, -2, 3], [2, 2, 6], (count, 3))
    aside = np.where(np.arange(count) < tight, 0.0, 2.0)[:, None] * [1, 0, 0]
    rays = (points - aside)[:, :2] / (points - aside)[:, 2:]
    rays[tight:] += rng.uniform(-0.0015, 0.0015, (loose, 2))
    return points, rays


@pytest.mark.parametrize(
    ("tight", "loose", "x_inliers", "x_msac"), [(30, 33, 2, 0), (30, 60, 2, 2), (30, 30, 0, 0)]
)
def test_score_count_prefers_more_msac_better(tight, loose, x_inliers, x_msac):
    """A few inliers more win the count; to MSAC their misfit costs more than that."""
    points, rays = two_views(tight, loose)
    by_count = to_problem(points, rays, points, inlier_cost=0.999 / len(points))
    by_msac = to_problem(points, rays, points)
    assert consensus_on(by_count).T_odom_cam[0, 3] == pytest.approx(x_inliers, abs=0.01)
    assert consensus_on(by_msac).T_odom_cam[0, 3] == pytest.approx(x_msac, abs=0.01)


def test_cost_hand_worked():
    """One match exact, one at half the threshold, one beyond it, one behind the camera."""
    points = np.array([[0.0, 0, 2], [1, 1, 2], [0, 1, 2], [0, 0, -2]])
    rays = np.array([[0.0, 0], [0.5 + THRESHOLD / 2, 0.5], [0, 0.6], [0, 0]])
    pose = np.eye(3, 4)
    matches = to_problem(points, rays, points)
    errors = np.empty(4)
    squared_errors(matches, pose, 0, 4, errors)
    np.testing.assert_allclose(errors, [0, 0.25, (0.1 / THRESHOLD) ** 2, np.inf], atol=1e-12)
    assert cost(matches, pose, 0, 4, np.inf) == pytest.approx(2.25)
    assert cost(matches, pose, 1, 3, np.inf) == pytest.approx(1.25)
    assert cost(matches, pose, 0, 4, 2.24) == np.inf
    assert cost(matches._replace(inlier_cost=0.1), pose, 0, 4, np.inf) == pytest.approx(2.025)
    weighted = matches._replace(weights=np.array([1, 4, 2, 0.0]))
    assert cost(weighted, pose, 0, 4, np.inf) == pytest.approx(4 * 0.25 + 2)
    np.testing.assert_array_equal(inlier_rows(matches, pose), [0, 1])
    metric = matches._replace(metric=True, points_cam=points + np.array([0, 0, 0.3]), threshold=0.5)
    squared_errors(metric, pose, 0, 4, errors)
    np.testing.assert_allclose(errors, [0.36, 0.36, 0.36, np.inf])


def test_cost_with_bail_equals_full_cost():
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


def test_draw_sample_triplets_are_equally_likely():
    rng = np.random.default_rng(0)
    seen = np.zeros((5, 5, 5))
    sample = np.empty(3, dtype=np.int64)
    draws = 60_000
    for draw in rng.random((draws, 3)):
        draw_sample(draw, np.arange(6.0), sample)
        seen[tuple(sample)] += 1
    distinct = np.array([len({i, j, k}) == 3 for i, j, k in np.ndindex(5, 5, 5)]).reshape(5, 5, 5)
    assert (seen[~distinct] == 0).all()
    expected = draws / 60
    assert np.abs(seen[distinct] - expected).max() < 4.5 * np.sqrt(expected)


def test_draw_sample_follows_weights():
    """Against drawing without replacement by NumPy's generator."""
    weights = np.array([1.0, 0, 2, 3, 4])
    rng = np.random.default_rng(0)
    sample = np.empty(3, dtype=np.int64)
    drawn, expected = np.zeros((2, 5, 3))
    for draw in rng.random((20_000, 3)):
        draw_sample(draw, cumulative_weights(weights), sample)
        assert len(set(sample)) == 3
        drawn[sample, range(3)] += 1
        expected[rng.choice(5, 3, replace=False, p=weights / 10), range(3)] += 1
    assert (drawn[1] == 0).all()
    assert np.abs(drawn - expected).max() < 4.5 * np.sqrt(2 * 20_000 / 4)


def test_ransac_weights_beat_larger_group():
    """Sixty matches agree on one motion, forty that weigh three times as much on another."""
    points, rays = two_views(40, 60)
    weights = np.where(np.arange(100) < 40, 3.0, 1.0)
    matches = to_problem(points, rays, points)
    assert consensus_on(matches).T_odom_cam[0, 3] == pytest.approx(2, abs=0.01)
    for scheme in ("adaptive", "preemptive"):
        found = consensus_on(matches._replace(weights=weights), scheme=scheme)
        assert found.T_odom_cam[0, 3] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_ransac_fewer_than_three_matches_give_none(count, scheme):
    assert consensus_on(problem(count, 1.0)[0], scheme=scheme) is None


def test_ransac_three_matches_are_enough():
    assert consensus_on(problem(3, 1.0)[0]).inliers.all()


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_ransac_collinear_points_give_none(scheme):
    matches, _ = problem(10, 1.0)
    line = np.linspace(1, 2, 10)[:, None] * np.array([[0.2, 0.1, 1.0]]) + [1, 0, 0]
    assert consensus_on(matches._replace(points_odom=line), scheme=scheme) is None


@pytest.mark.parametrize("scheme", ["adaptive", "preemptive"])
def test_ransac_same_seed_gives_same_consensus(scheme):
    matches, _ = problem(100, 0.4, noise=0.001)
    a, b, other = (
        consensus_on(matches, seed=seed, scheme=scheme, local_iterations=0) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(a.T_odom_cam, b.T_odom_cam)
    np.testing.assert_array_equal(a.inliers, b.inliers)
    assert (a.T_odom_cam != other.T_odom_cam).any()


def test_preemptive_draws_exactly_its_budget():
    matches, good = problem(300, 0.5, noise=0.0005)
    found = consensus_on(matches, scheme="preemptive", max_hypotheses=100)
    assert samples_drawn(matches, search_preemptive, most=100) == 100
    assert found.inliers[good].mean() > 0.98
