"""World of noisy points in which the Cramér–Rao bound is attained; `driftyard point-world`.

Nothing is rendered: a camera moves in front of points whose measurements have independent Gaussian
errors of known size. The estimator's bundle adjustment must attain the bound that
`trials.evaluation.information` computes.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from trials.evaluation.information import pose_covariance
from vo.bundle_adjustment.adjust import Bundle, refine_motion, refine_structure
from vo.config import MotionSettings, RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig
from vo.pose.estimation import estimate_pose

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
SIGMA_PX = np.array([0.2, 0.2, 0.2])
"""Std. dev. of u, v and disparity, px."""
FRAMES, POINTS = 8, 80
STEP = np.array([0.02, 0.0, 0.08, 0.0, 0.02, 0.005])
"""Motion from frame to frame, tangent (v m, w rad)."""
REFINEMENT = RefinementSettings(huber=1e6, max_iterations=50)
TOLERANCE = 0.1
"""Largest relative distance from the bound."""


@dataclass(frozen=True)
class PointWorld:
    """Camera poses, points, and noisy measurements.

    Attributes:
        T_odom_cam: (F, 4, 4), the first the identity.
        points_odom: (N, 3) metres, 1.5 to 5 m before the first camera.
        measured: (F, N, 3) noisy u, v and disparity.
    """

    T_odom_cam: Array
    points_odom: Array
    measured: Array


def make_world(rng: np.random.Generator) -> PointWorld:
    """Draw a world in which every camera observes every point."""
    step = se3.exp(STEP)
    T_odom_cam = np.array([np.linalg.matrix_power(step, i) for i in range(FRAMES)])
    pixels = rng.uniform([120, 100], [520, 380], (POINTS, 2))
    depth_m = rng.uniform(1.5, 5, POINTS)
    points_odom = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / depth_m)
    exact = RIG.project(se3.transform(se3.inverse(T_odom_cam), points_odom))
    return PointWorld(T_odom_cam, points_odom, exact + rng.normal(scale=SIGMA_PX, size=exact.shape))


def estimated_poses(world: PointWorld, rng: np.random.Generator) -> Array:
    """Track the points frame by frame, then refine motion and structure; returns (F, 4, 4)."""
    first = world.measured[0]
    points = RIG.triangulate(first[:, :2], first[:, 2])
    T_odom_cam = [np.eye(4)]
    sigma = np.tile(SIGMA_PX, (POINTS, 1))
    for seen in world.measured[1:]:
        rays = RIG.normalized(seen[:, :2])
        found = estimate_pose(points, rays, np.full_like(points, np.nan), MotionSettings(), rng)
        if found is None:
            raise SettingsError("point world: RANSAC found no motion")
        pose = refine_motion(found.T_odom_cam, points, seen, sigma, RIG, REFINEMENT)
        T_odom_cam.append(pose.T_world_cam)
    bundle = Bundle(
        T_world_cam=np.array(T_odom_cam),
        points_world=points,
        camera=np.repeat(np.arange(FRAMES), POINTS),
        point=np.tile(np.arange(POINTS), FRAMES),
        measured=world.measured.reshape(-1, 3),
        sigma=np.tile(SIGMA_PX, (FRAMES * POINTS, 1)),
        fixed=np.arange(FRAMES) == 0,
        K=RIG.K,
        baseline_m=RIG.baseline_m,
    )
    return refine_structure(bundle, REFINEMENT).T_world_cam


def bound_covariance(world: PointWorld) -> Array:
    """Return the bound (6 F, 6 F) of the poses of a world."""
    camera, point = np.repeat(np.arange(FRAMES), POINTS), np.tile(np.arange(POINTS), FRAMES)
    sigma = np.tile(SIGMA_PX, (FRAMES * POINTS, 1))
    return pose_covariance(world.T_odom_cam, world.points_odom, camera, point, sigma, RIG)


def mean_squares(world: PointWorld, T_odom_cam: Array) -> Array:
    """Return mean squares of the errors of poses, and their bounds.

    Returns:
        (2, 2) rows: achieved, bound; columns: position, m^2, and rotation, rad^2.
    """
    errors = se3.log(se3.inverse(world.T_odom_cam[1:]) @ T_odom_cam[1:])
    variances = np.diag(bound_covariance(world)).reshape(-1, 6)[1:]
    halves = (x.reshape(-1, 2, 3).sum(axis=2) for x in (errors**2, variances))
    return np.array([x.mean(axis=0) for x in halves])


def compare_with_bound(seeds: Iterable[int]) -> Array:
    """Return the mean of `mean_squares` (2, 2) over worlds, one for each seed."""
    worlds = (make_world(np.random.default_rng(seed)) for seed in seeds)
    found = [mean_squares(x, estimated_poses(x, np.random.default_rng(0))) for x in worlds]
    return np.array(found).mean(axis=0)
