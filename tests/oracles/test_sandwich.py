"""Covariances by residuals: against the elimination of each point alone, and against noise."""

import numpy as np
import pytest
from passage import RIG, SIGMA, Passage, collected

from vo.bundle_adjustment.adjust import refine_motion
from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.config import RefinementSettings
from vo.contract import se3

PLAIN = RefinementSettings(huber=1e6, max_iterations=50)


def test_score_products_match_single_points():
    """A bundle of one landmark has its score as the gradient."""
    passage = Passage(1, 4, fresh=8)
    ids = np.intersect1d(
        passage.keyframes[0].observations.ids, passage.keyframes[3].observations.ids
    )
    moving = np.arange(4) > 0

    def estimates_of(landmarks, points):
        bundle = collected(passage.keyframes, landmarks, points, ~moving)
        return PointEstimates(bundle)

    together = estimates_of(ids, passage.points[ids])
    for _ in range(3):  # until the points have converged
        together.linearize(passage.T_odom_cam, moving, derivatives=False)
    scores = []
    for row, landmark in enumerate(ids):
        single = estimates_of(np.array([landmark]), together.points[[row]])
        own = moving[single.cameras]
        score = np.zeros((4, 6))
        score[single.cameras[own]] = single.linearize(
            passage.T_odom_cam[single.cameras], own, derivatives=True
        )[1].reshape(-1, 6)
        scores.append(score[moving].ravel())
    B = together.score_products(passage.T_odom_cam, moving)
    expected = np.transpose(scores) @ scores
    np.testing.assert_allclose(B, expected, rtol=1e-4, atol=1e-4 * np.abs(B).max())


def test_covariance_follows_residuals_above_assumed_noise():
    """Measurements err three times as much as stated: only residuals show it."""
    assumed, robust = [], []
    for seed in range(60):
        passage = Passage(seed, 1, fresh=300, sigma=3 * SIGMA)
        seen = passage.keyframes[0].observations
        points = passage.points[seen.ids]
        pose = refine_motion(np.eye(4), points, seen.measured, seen.sigma_px, RIG, PLAIN)
        error = se3.log(pose.T_world_cam)
        robust.append(error @ np.linalg.solve(pose.covariance, error))
        exact = refine_motion(np.eye(4), points, RIG.project(points), seen.sigma_px, RIG, PLAIN)
        assumed.append(error @ np.linalg.solve(exact.covariance, error))
    # Means of 60 chi-squared with 6 degrees deviate by sqrt(12 / 60) = 0.45.
    assert np.mean(assumed) == pytest.approx(54, abs=9 * 1.8)
    # A covariance of some 24 squares is uncertain itself: Hotelling's T² has a mean of about 8.
    assert np.mean(robust) == pytest.approx(8, abs=1.8)


def test_covariance_follows_errors_that_neighbours_share():
    """The points of each square of the image err alike, as those of one moving object do."""
    sizes = []
    for seed in range(60):
        seen = Passage(seed, 1, fresh=300).keyframes[0].observations
        column, row = (seen.pixels // (RIG.width_px / 6)).astype(int).T
        common = np.random.default_rng(seed).normal(scale=SIGMA, size=(6, 6, 3))[row, column]
        points = Passage(seed, 1, fresh=300).points[seen.ids]
        measured = RIG.project(points) + common
        pose = refine_motion(np.eye(4), points, measured, seen.sigma_px, RIG, PLAIN)
        error = se3.log(pose.T_world_cam)
        sizes.append(error @ np.linalg.solve(pose.covariance, error))
    assert np.mean(sizes) < 10  # 6 if exact; 36 if each point counted as one measurement
