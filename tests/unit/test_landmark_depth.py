"""A frame's pose weighs landmarks by the error of their depth, which grows with the disparity's."""

import numpy as np
from scipy.optimize import least_squares

from vo.bundle_adjustment.adjust import refine_motion, refine_structure
from vo.bundle_adjustment.problem import Bundle
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.projection import project_points
from vo.contract.rig import StereoRig

ROAD = StereoRig(1226, 370, 707, 612.5, 184.5, 0.54)
SIGMA_PX = 0.1
PLAIN = RefinementSettings(huber=1e6, max_iterations=50)


class Step:
    """Points whose depth was measured by one disparity, seen again 1.2 m further on."""

    def __init__(self, seed: int, n: int = 150) -> None:
        rng = np.random.default_rng(seed)
        pixels = rng.uniform((0, 0), (1226, 370), (n, 2))
        disparity = 0.54 * 707 / rng.uniform(6, 60, n)
        measured = disparity + rng.normal(0, SIGMA_PX, n)
        self.T = se3.exp(np.array([0.02, -0.01, 1.2, 0.002, -0.004, 0.001]))
        self.points = ROAD.triangulate(pixels, measured)
        self.spread = self.points * (SIGMA_PX / measured)[:, None]
        seen = project_points(ROAD.triangulate(pixels, disparity), self.T, ROAD)
        self.measured = seen + rng.normal(0, SIGMA_PX, (n, 3))
        self.sigma = np.full((n, 3), SIGMA_PX)

    def refined(self, spread: Array | None) -> tuple[Array, Array]:
        """Error (6,) of the refined pose, and its covariance (6, 6)."""
        seen = self.points, self.measured, self.sigma
        pose = refine_motion(self.T, *seen, ROAD, PLAIN, spread)
        return se3.log(se3.inverse(self.T) @ pose.T_world_cam), pose.covariance


def test_a_pose_knows_that_depths_err() -> None:
    """Seen on a road: near points at the rim of the image move by what their depth errs."""
    exact, weighed, sizes = [], [], []
    for seed in range(60):
        step = Step(seed)
        exact.append(step.refined(None)[0][2])
        error, covariance = step.refined(step.spread)
        weighed.append(error[2])
        sizes.append(error @ np.linalg.solve(covariance, error))
    assert np.std(weighed) < 0.85 * np.std(exact)  # along the view
    assert np.mean(sizes) < 8  # 6 if exact; the wider of two covariances is taken


def test_the_pose_is_that_of_depths_estimated_along() -> None:
    """Pose and depths together, each depth with its own measurement as a prior."""
    step = Step(7, n=40)

    def residuals(x: Array) -> Array:
        points = step.points + step.spread * x[6:, None]
        seen = project_points(points, step.T @ se3.exp(x[:6]), ROAD)
        return np.concatenate([((seen - step.measured) / step.sigma).ravel(), x[6:]])

    together = least_squares(residuals, np.zeros(46)).x[:6]
    np.testing.assert_allclose(step.refined(step.spread)[0], together, rtol=0.05, atol=1e-4)


def test_two_disparities_know_a_depth_twice_as_well() -> None:
    """Along the ray of both cameras no pixel moves, and each disparity tells one spread."""
    step = Step(3, n=30)
    seen = project_points(step.points, np.eye(4), ROAD)
    bundle = Bundle(
        T_world_cam=np.tile(np.eye(4), (2, 1, 1)),
        points_world=step.points,
        camera=np.repeat([0, 1], 30),
        point=np.tile(np.arange(30), 2),
        measured=np.tile(seen, (2, 1)),
        sigma=np.full((60, 3), SIGMA_PX),
        fixed=np.array([True, False]),
        K=ROAD.K,
        baseline_m=ROAD.baseline_m,
    )
    information = refine_structure(bundle, PLAIN).information
    known = np.einsum("ni,nij,nj->n", step.spread, information, step.spread)
    np.testing.assert_allclose(known, 2, rtol=0.02)
