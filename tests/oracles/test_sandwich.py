"""Covariances by residuals: against the reduction of each point alone, and against noise."""

import numpy as np
import pytest
from passage import RIG, SIGMA, Passage

from vo.bundle_adjustment.adjust import refine_motion
from vo.bundle_adjustment.problem import chunks, collect, split_pose
from vo.bundle_adjustment.schur import reduce
from vo.config import RefinementSettings
from vo.contract import se3

PLAIN = RefinementSettings(huber=1e6, most_iterations=50)


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
    values = {"assumed": [], "residuals": []}
    for seed in range(60):
        passage = Passage(seed, 1, fresh=300, sigma=3 * SIGMA)
        sight = passage.sights[0]
        for kind, found in values.items():
            s = PLAIN.model_copy(update={"covariance": kind})
            data = passage.points[sight.ids], sight.measured, sight.sigma
            pose = refine_motion(np.eye(4), *data, RIG, s)
            error = se3.log(pose.T_world_cam)
            found.append(error @ np.linalg.solve(pose.covariance, error))
    # Means of 60 chi-squared with 6 degrees deviate by sqrt(12 / 60) = 0.45.
    assert np.mean(values["assumed"]) == pytest.approx(54, abs=9 * 1.8)
    assert np.mean(values["residuals"]) == pytest.approx(6, abs=1.8)
