"""Covariances by residuals: against the reduction of each point alone, and against noise."""

import numpy as np
import pytest
from passage import RIG, SIGMA, Passage

from vo.bundle_adjustment.adjust import refine_motion
from vo.bundle_adjustment.problem import chunks, collect, intrinsics, split_pose, weigh
from vo.bundle_adjustment.schur import camera_normal, reduce
from vo.config import RefinementSettings
from vo.contract import se3

PLAIN = RefinementSettings(huber=1e6, max_iterations=50)


def test_shares_are_the_gradients_of_single_points():
    passage = Passage(1, 4, fresh=8)
    ids = np.intersect1d(passage.sights[0].ids, passage.sights[3].ids)
    bundle = collect(passage.sights, ids, passage.points[ids], np.arange(4) == 0, RIG)
    (chunk,) = chunks(bundle)
    slot, size = np.arange(-1, 3), 3

    def gradients(measured):
        for j in range(len(ids)):
            own = slice(chunk.first[j], chunk.first[j + 1])
            yield reduce(
                *split_pose(bundle.T_world_cam), chunk.points[j : j + 1],
                np.array([0, own.stop - own.start]), chunk.camera[own], measured[own],
                chunk.weight[own], chunk.intrinsics, slot, size,
            )[1]  # fmt: skip

    for _ in range(3):  # the points settle
        chunk.normal(bundle.T_world_cam, ~bundle.fixed, derivatives=False)
    B = chunk.shares(bundle.T_world_cam, ~bundle.fixed)
    each = np.array(list(gradients(chunk.measured)))
    np.testing.assert_allclose(B, each.T @ each, rtol=1e-4, atol=1e-4 * np.abs(B).max())


def test_residuals_tell_noise_that_is_larger_than_assumed():
    """Measurements err three times as much as stated: only residuals know it."""
    assumed, by_residuals = [], []
    for seed in range(60):
        passage = Passage(seed, 1, fresh=300, sigma=3 * SIGMA)
        sight = passage.sights[0]
        data = passage.points[sight.ids], sight.measured, sight.sigma
        pose = refine_motion(np.eye(4), *data, RIG, PLAIN)
        error = se3.log(pose.T_world_cam)
        by_residuals.append(error @ np.linalg.solve(pose.covariance, error))
        measured, weight = weigh(sight.measured, sight.sigma, use_disparity=True)
        R, t = pose.T_world_cam[:3, :3].copy(), pose.T_world_cam[:3, 3].copy()
        f = intrinsics(RIG.K, RIG.baseline_m)
        information = camera_normal(R, t, data[0], measured, weight, f)[0]
        error = np.roll(error, 3)  # as GTSAM, rotation first
        assumed.append(error @ information @ error)
    # Means of 60 chi-squared with 6 degrees deviate by sqrt(12 / 60) = 0.45.
    assert np.mean(assumed) == pytest.approx(54, abs=9 * 1.8)
    assert np.mean(by_residuals) == pytest.approx(6, abs=1.8)
