"""The estimator's back end in a world of points, whose noise says how large its errors must be."""

import numpy as np
import pytest

from vo.bundle_adjustment.adjust import refine_motion, refine_structure
from vo.bundle_adjustment.problem import Bundle
from vo.config import MotionSettings, RefinementSettings
from vo.contract import se3
from vo.contract.rig import StereoRig
from vo.pose.estimation import estimate_pose, reprojection_errors

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
SIGMA_PX, SIGMA_DISPARITY_PX = 0.2, 0.2
SIGMA = np.array([SIGMA_PX, SIGMA_PX, SIGMA_DISPARITY_PX])
REFINEMENT = RefinementSettings(huber=1e6, max_iterations=50)
MOTION = MotionSettings(threshold=0.003)
FRAMES, POINTS, WORLDS = 6, 60, 25
UNKNOWN = 6 * (FRAMES - 1)


class PointWorld:
    """A camera that moves 8 cm a frame and turns, before points 1.5 to 5 m away.

    Everything is given in the first camera's frame, `odom`.
    """

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        step = se3.exp(np.array([0.02, 0.0, 0.08, 0.0, 0.02, 0.005]))
        self.T_odom_cam = np.array([np.linalg.matrix_power(step, i) for i in range(FRAMES)])
        pixels = rng.uniform([120, 100], [520, 380], (POINTS, 2))
        depth_m = rng.uniform(1.5, 5, POINTS)
        self.points_odom = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / depth_m)
        exact = project(self.T_odom_cam, self.points_odom)
        sigma = [SIGMA_PX, SIGMA_PX, SIGMA_DISPARITY_PX]
        self.measured = exact + rng.normal(scale=sigma, size=exact.shape)


def project(T_odom_cam, points_odom):
    """(F, N, 3) of (u, v, disparity) in every frame."""
    return RIG.project(se3.transform(se3.inverse(T_odom_cam), points_odom))


def follow(world, outliers=0):
    """Frame by frame: landmarks of the first frame, P3P under RANSAC, motion refinement."""
    rng = np.random.default_rng(0)
    first = world.measured[0]
    landmarks = RIG.triangulate(first[:, :2], first[:, 2])
    T_odom_cam = [np.eye(4)]
    for seen in world.measured[1:]:
        pixels = seen[:, :2].copy()
        pixels[:outliers] = rng.uniform([0, 0], [640, 480], (outliers, 2))
        no_depth = np.full_like(landmarks, np.nan)
        found = estimate_pose(landmarks, RIG.normalized(pixels), no_depth, MOTION, rng)
        assert not found.inliers[:outliers].any()
        assert found.inliers[outliers:].mean() > 0.7  # a sample of three noisy landmarks
        keep = found.inliers
        measured = np.column_stack([pixels, seen[:, 2]])[keep]
        sigma = np.tile(SIGMA, (keep.sum(), 1))
        pose = refine_motion(found.T_odom_cam, landmarks[keep], measured, sigma, RIG, REFINEMENT)
        T_odom_cam.append(pose.T_world_cam)
    return np.array(T_odom_cam), landmarks


def bundle(world, T_odom_cam, landmarks):
    seen = world.measured.reshape(-1, 3)
    return Bundle(
        T_world_cam=T_odom_cam,
        points_world=landmarks,
        camera=np.repeat(np.arange(FRAMES), POINTS),
        point=np.tile(np.arange(POINTS), FRAMES),
        measured=seen,
        sigma=np.tile(SIGMA, (len(seen), 1)),
        fixed=np.arange(FRAMES) == 0,
        K=RIG.K,
        baseline_m=RIG.baseline_m,
    )


def information(world):
    """(U, U) inverse covariance of all poses but the first, the points eliminated.

    By central differences at the truth, and the Schur complement of the points.
    """
    step = 1e-6
    poses = np.zeros((FRAMES, POINTS, 3, UNKNOWN))
    points = np.zeros((FRAMES, POINTS, 3, 3))
    for k, e in enumerate(step * np.eye(6)):
        ahead, back = (
            project(world.T_odom_cam @ se3.exp(s * e), world.points_odom) for s in (1, -1)
        )
        slope = (ahead - back) / (2 * step) / SIGMA
        for i in range(1, FRAMES):
            poses[i, :, :, 6 * (i - 1) + k] = slope[i]
    for k, e in enumerate(step * np.eye(3)):
        ahead, back = (project(world.T_odom_cam, world.points_odom + s * e) for s in (1, -1))
        points[..., k] = (ahead - back) / (2 * step) / SIGMA
    total = np.einsum("ijku,ijkw->uw", poses, poses)
    cross = np.einsum("ijku,ijkp->jup", poses, points)
    own = np.einsum("ijkp,ijkq->jpq", points, points)
    return total - np.einsum("jup,jpq,jwq->uw", cross, np.linalg.inv(own), cross)


def tangent_errors(world, T_odom_cam):
    """(F - 1, 6) error of each pose but the first, (v m, w rad)."""
    return se3.log(se3.inverse(world.T_odom_cam[1:]) @ T_odom_cam[1:])


def rmse_m(errors):
    return np.sqrt((np.asarray(errors)[..., :3] ** 2).sum(axis=-1).mean())


@pytest.fixture(scope="module")
def worlds():
    return [PointWorld(seed) for seed in range(WORLDS)]


@pytest.fixture(scope="module")
def followed(worlds):
    return [follow(world) for world in worlds]


@pytest.fixture(scope="module")
def refined(worlds, followed):
    return [
        refine_structure(bundle(world, *start), REFINEMENT).T_world_cam
        for world, start in zip(worlds, followed, strict=True)
    ]


def test_refined_pose_errors_match_their_covariance(worlds, refined):
    """Squared errors over their covariance: as many as there are unknowns."""
    normalised, errors, expected_m2 = [], [], []
    for world, T_odom_cam in zip(worlds, refined, strict=True):
        error = tangent_errors(world, T_odom_cam)
        inverse = information(world)
        normalised.append(error.ravel() @ inverse @ error.ravel())
        errors.append(error)
        variance = np.diag(np.linalg.inv(inverse)).reshape(-1, 6)
        expected_m2.append(variance[:, :3].sum(axis=1).mean())
    # The mean of 25 chi-squared with 30 degrees deviates by sqrt(60 / 25) = 1.5.
    assert UNKNOWN - 6 < np.mean(normalised) < UNKNOWN + 6
    expected_m = np.sqrt(np.mean(expected_m2))
    assert 0.8 * expected_m < rmse_m(errors) < 1.25 * expected_m
    assert 2e-4 < expected_m < 5e-3


def test_tracked_pose_errors_exceed_refined_ones_slightly(worlds, followed, refined):
    """Landmarks of one frame carry its noise for ever; refinement takes most of it away."""
    before = rmse_m([tangent_errors(w, T) for w, (T, _) in zip(worlds, followed, strict=True)])
    after = rmse_m([tangent_errors(w, T) for w, T in zip(worlds, refined, strict=True)])
    assert 1.1 * after < before < 6 * after


def test_refinement_improves_structure(worlds, followed):
    world, start = worlds[0], followed[0]
    better = refine_structure(bundle(world, *start), REFINEMENT)
    before, after = (
        np.sqrt(((x - world.points_odom) ** 2).sum(axis=1).mean())
        for x in (start[1], better.points_world)
    )
    assert 0.1 * before < after < 0.8 * before


def test_outliers_have_little_effect(worlds, followed):
    plain = rmse_m(
        [tangent_errors(w, T) for w, (T, _) in zip(worlds[:8], followed[:8], strict=True)]
    )
    spoilt = rmse_m([tangent_errors(w, follow(w, outliers=20)[0]) for w in worlds[:8]])
    assert 0 < spoilt < 2 * plain


def test_errors_are_proportional_to_noise(worlds, refined):
    whole = rmse_m([tangent_errors(w, T) for w, T in zip(worlds, refined, strict=True)])
    halves = []
    for seed in range(WORLDS):
        world = PointWorld(seed)
        exact = project(world.T_odom_cam, world.points_odom)
        world.measured = exact + 0.5 * (world.measured - exact)
        T = refine_structure(bundle(world, *follow(world)), REFINEMENT).T_world_cam
        halves.append(tangent_errors(world, T))
    assert rmse_m(halves) == pytest.approx(whole / 2, rel=0.05)


def test_points_behind_the_camera_have_no_residual():
    """They project to the same ray, so only the sign of their depth tells."""
    points = np.array([[0.5, 0.2, 2.0], [-0.5, -0.2, -2.0], [0.5, 0.2, 0.0]])
    rays = np.array([[0.25, 0.1], [0.25, 0.1], [0.25, 0.1]])
    errors = reprojection_errors(np.array([np.eye(4), np.eye(4)]), points, rays)
    np.testing.assert_allclose(errors, [[0, np.nan, np.nan]] * 2, atol=1e-12)
