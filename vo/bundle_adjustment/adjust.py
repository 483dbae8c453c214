"""Bundle adjustment: motion only, or motion and structure (thesis 2.8, 3.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vo.bundle_adjustment.gtsam_backend import optimize_factors
from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.bundle_adjustment.problem import Bundle, as_cameras, intrinsics, point_blocks, weigh
from vo.bundle_adjustment.robust_covariance import camera_score_products, robust_covariance
from vo.bundle_adjustment.schur import Measurements, camera_normal_equations, robust_weights
from vo.bundle_adjustment.solver import TURN_LAST, CostTerm, information_inverse, optimize
from vo.config import RefinementSettings
from vo.contract.arrays import Array, Mask
from vo.contract.rig import StereoRig


def optimize_reduced(
    bundle: Bundle, estimates: Sequence[PointEstimates], settings: RefinementSettings
) -> tuple[Array, int]:
    """Solve the reduced camera system, with Huber weights that are renewed after the first step.

    The measurements of each block of points become one factor on its cameras: GTSAM then solves for
    the cameras alone, and Python is entered once an iteration and factor (docs/decisions/0006).
    """
    T, moving = bundle.T_world_cam.copy(), ~bundle.fixed
    terms = [_term(x, T, moving) for x in estimates if moving[x.block.cameras].any()]
    iterations, most = 0, settings.max_iterations
    for steps_left in (1, most - 1)[:most]:
        for x in estimates:
            x.reweight(T[x.block.cameras], settings.huber)
        T[moving], steps = optimize(T[moving], terms, steps_left)
        iterations += steps
    return T, iterations


def _term(estimates: PointEstimates, T: Array, moving: Mask) -> CostTerm:
    """Make the cost of a block by its moving cameras; the others stay as they are."""
    cameras = estimates.block.cameras
    here, own = T[cameras].copy(), moving[cameras]
    rows = (np.cumsum(moving) - 1)[cameras[own]]

    def linearize(poses: Array, derivatives: bool) -> tuple[Array, Array, float]:
        here[own] = poses
        return estimates.linearize(here, own, derivatives)

    return CostTerm(rows, linearize)


BACKENDS = {"schur": optimize_reduced, "gtsam": optimize_factors}
"""Optimisers of cameras and points by `refinement.backend`.

Each takes a bundle, the estimates of all of its blocks, which it leaves at the solution, and
settings; it returns the cameras (K, 4, 4) and its Levenberg-Marquardt steps.
"""

REWEIGHTINGS = 3
"""Rounds in which the Huber weights are renewed (Holland and Welsch, 1977), for one camera."""

SIX = np.arange(6)

MEDIAN_CHI2 = (1.386, 0.455)
"""Medians of chi-squared with two degrees of freedom, a pixel's, and with one, a disparity's."""


@dataclass(frozen=True)
class Refined:
    """Solution of a bundle.

    Attributes:
        T_world_cam: (K, 4, 4).
        points_world: (J, 3) metres.
        covariance: (K, 6, 6) of each camera given the fixed ones, tangent (v m, w rad) in its own
            frame; zero for those, and for all if it was not asked for.
        iterations: Levenberg-Marquardt steps; the largest number allowed if it did not converge.
        error: Final value of half the summed robust squared whitened residuals.
        misfit: (2,) median squared residual of pixels and of disparities, over what their sigmas
            make one expect; 1 where they are right, NaN where there are none.
    """

    T_world_cam: Array
    points_world: Array
    covariance: Array
    iterations: int
    error: float
    misfit: Array


@dataclass(frozen=True)
class Pose:
    """A camera (4, 4) refined on points that stay, and the Levenberg-Marquardt steps that it took.

    The covariance (6, 6), by the measurements alone, is of tangents (v m, w rad) in its own frame.
    """

    T_world_cam: Array
    covariance: Array
    iterations: int


def refine_structure(
    bundle: Bundle, settings: RefinementSettings, covariances: bool = True
) -> Refined:
    """Minimise the reprojection error over all cameras that may move and all points.

    Every point should be seen by at least three cameras (thesis 4.4); this function takes what
    it is given. The covariances of K cameras cost K cubed.

    Source: thesis eq. 2.29 with a Huber loss; the gauge is held by the fixed cameras.
    """
    estimates = [PointEstimates(x) for x in point_blocks(bundle, settings.use_disparity)]
    moving = ~bundle.fixed
    T, iterations = BACKENDS[settings.backend](bundle, estimates, settings)
    points, error = bundle.points_world.copy(), 0.0
    for x in estimates:
        cameras = x.block.cameras
        error += x.linearize(T[cameras], moving[cameras], derivatives=False)[2]
        points[x.block.rows] = x.points
    covariance = np.zeros((len(T), 6, 6))
    if covariances:
        covariance[moving] = _covariances(estimates, T, moving)
    return Refined(T, points, covariance, iterations, error, misfit(estimates, T))


def _covariances(estimates: Sequence[PointEstimates], T: Array, moving: Mask) -> Array:
    """Covariance (S, 6, 6) of each moving camera given the fixed ones, tangents (v, w)."""
    size = int(moving.sum())
    H, B = np.zeros((size, 6, size, 6)), np.zeros((size, 6, size, 6))
    for x in estimates:
        here, own = T[x.block.cameras], moving[x.block.cameras]
        rows = (np.cumsum(moving) - 1)[x.block.cameras[own]]
        n, part = len(rows), np.ix_(rows, SIX, rows, SIX)
        H[part] += x.linearize(here, own, derivatives=True)[0].reshape(n, 6, n, 6)
        B[part] += x.score_products(here, own).reshape(n, 6, n, 6)
    inverse = information_inverse(H.reshape(6 * size, 6 * size))
    covariance = robust_covariance(inverse, B.reshape(6 * size, 6 * size))
    blocks = covariance.reshape(size, 6, size, 6)[np.arange(size), :, np.arange(size)]
    return blocks[:, TURN_LAST][:, :, TURN_LAST]


def misfit(estimates: Sequence[PointEstimates], T: Array) -> Array:
    """Median squared residual of pixels and of disparities over what is expected, (2,)."""
    residuals = np.concatenate([x.residuals(T[x.block.cameras]) for x in estimates])
    weight = np.concatenate([x.block.data.weight for x in estimates])
    pixels = (residuals[:, :2] ** 2).sum(axis=1)
    disparities = residuals[weight[:, 2] > 0, 2] ** 2
    parts = zip((pixels, disparities), MEDIAN_CHI2, strict=True)
    return np.array([np.median(x) / chi2 if len(x) else np.nan for x, chi2 in parts])


def refine_motion(
    T_world_cam: Array,
    points_world: Array,
    measured: Array,
    sigma: Array,
    rig: StereoRig,
    settings: RefinementSettings,
) -> Pose:
    """Minimise the reprojection error over one camera, from (4, 4), while the points (N, 3) stay.

    Measured are (N, 3) left-image u, v and disparity, pixels or NaN, with (N, 3) sigmas.
    """
    seen, known = weigh(measured, sigma, settings.use_disparity)
    points = np.ascontiguousarray(points_world, dtype=np.float64)
    f = intrinsics(rig.K, rig.baseline_m)
    n = len(points)
    data = Measurements(np.arange(n + 1), np.zeros(n, np.int64), seen, known, f)
    poses, weighted, iterations = T_world_cam[None], data, 0

    def linearize(poses: Array, derivatives: bool = True) -> tuple[Array, Array, float]:
        return camera_normal_equations(as_cameras(poses), points, weighted)

    term = CostTerm(np.array([0]), linearize)
    for _ in range(REWEIGHTINGS if n else 0):
        weight = robust_weights(as_cameras(poses), points, data, settings.huber)
        weighted = data._replace(weight=weight)
        poses, more = optimize(poses, [term], settings.max_iterations)
        iterations += more
    B = camera_score_products(as_cameras(poses), points, weighted)
    covariance = robust_covariance(information_inverse(linearize(poses)[0]), B)
    return Pose(poses[0], covariance[TURN_LAST][:, TURN_LAST], iterations)
