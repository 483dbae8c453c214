"""The bound against the marginals of GTSAM and the errors of bundle adjustment."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from trials.evaluation.information import motion_covariance, pose_covariance
from trials.studies.point_world import (
    FRAMES,
    POINTS,
    RIG,
    SIGMA_PX,
    TOLERANCE,
    bound_covariance,
    estimated_poses,
    make_world,
    mean_squares,
)
from vo.contract import se3

TURN_LAST = [3, 4, 5, 0, 1, 2]
"""From GTSAM's tangents (w, v) to (v, w)."""


@pytest.fixture(scope="module")
def world():
    return make_world(np.random.default_rng(0))


@pytest.fixture(scope="module")
def marginals(world):
    calibration = gtsam.Cal3_S2Stereo(RIG.f_px, RIG.f_px, 0, RIG.cx_px, RIG.cy_px, RIG.baseline_m)
    # GTSAM measures u_left, u_right, v: with d = u_left - u_right, u_right = u_left - d.
    turn = np.array([[1, 0, 0], [1, 0, -1], [0, 1, 0.0]])
    noise = gtsam.noiseModel.Gaussian.Covariance(turn @ np.diag(SIGMA_PX**2) @ turn.T)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.NonlinearEqualityPose3(X(0), gtsam.Pose3(np.eye(4))))
    for i, T in enumerate(world.T_odom_cam):
        values.insert(X(i), gtsam.Pose3(T))
        seen = RIG.project(se3.transform(se3.inverse(T), world.points_odom))
        for j, (u, v, d) in enumerate(seen):
            point = gtsam.StereoPoint2(u, u - d, v)
            graph.add(gtsam.GenericStereoFactor3D(point, noise, X(i), L(j), calibration))
    for j, point in enumerate(world.points_odom):
        values.insert(L(j), point)
    return gtsam.Marginals(graph, values)


def test_pose_covariance_equals_gtsam_marginals(world, marginals):
    found = bound_covariance(world)
    np.testing.assert_array_equal(found[:6], 0)
    for i in range(1, FRAMES):
        block = slice(6 * i, 6 * i + 6)
        expected = marginals.marginalCovariance(X(i))[TURN_LAST][:, TURN_LAST]
        np.testing.assert_allclose(found[block, block], expected, rtol=1e-4, atol=1e-12)


def test_motion_covariance_equals_gtsam_joint_marginals(world, marginals):
    """By samples of both poses, composed."""
    i, j, n = 3, 6, 40_000
    keys = gtsam.KeyVector([X(i), X(j)])
    joint = marginals.jointMarginalCovariance(keys).fullMatrix()
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(12), joint, n)
    T_i, T_j = world.T_odom_cam[i], world.T_odom_cam[j]
    noisy_i, noisy_j = (
        T @ se3.exp(x[:, TURN_LAST]) for T, x in ((T_i, draws[:, :6]), (T_j, draws[:, 6:]))
    )
    errors = se3.log(se3.inverse(se3.inverse(T_i) @ T_j) @ se3.inverse(noisy_i) @ noisy_j)
    found = motion_covariance(bound_covariance(world), world.T_odom_cam, i, j)
    scale = np.sqrt(np.diag(found))
    np.testing.assert_allclose(
        np.cov(errors.T) / np.outer(scale, scale), found / np.outer(scale, scale), atol=0.03
    )


def test_infinite_sigma_carries_no_information(world):
    """Without disparities the first step's length is unknown; with some it is not."""
    camera, point = np.repeat(np.arange(FRAMES), POINTS), np.tile(np.arange(POINTS), FRAMES)
    sigma = np.tile(SIGMA_PX, (FRAMES * POINTS, 1))
    most = sigma.copy()
    most[point >= 5, 2] = np.inf
    args = (world.T_odom_cam, world.points_odom, camera, point)
    few = np.diag(pose_covariance(*args, most, RIG))[6:]
    assert (few > np.diag(pose_covariance(*args, sigma, RIG))[6:]).all()
    kept = point < 5
    alone = (world.T_odom_cam, world.points_odom[:5], camera[kept], point[kept], sigma[kept], RIG)
    assert (np.diag(pose_covariance(*alone))[6:] > few).all()


def test_poses_without_observations_have_no_bound(world):
    camera, point = np.repeat(np.arange(2), POINTS), np.tile(np.arange(POINTS), 2)
    sigma = np.tile(SIGMA_PX, (2 * POINTS, 1))
    with pytest.raises(np.linalg.LinAlgError):
        pose_covariance(world.T_odom_cam[:3], world.points_odom, camera, point, sigma, RIG)


def test_bundle_adjustment_attains_the_bound():
    found = np.array(
        [
            mean_squares(world, estimated_poses(world, np.random.default_rng(0)))
            for world in (make_world(np.random.default_rng(1000 + i)) for i in range(60))
        ]
    ).mean(axis=0)
    achieved, bound = np.sqrt(found)
    # Poses of a world go together, so 60 worlds leave about 5 %.
    np.testing.assert_allclose(achieved / bound, 1, atol=TOLERANCE)
