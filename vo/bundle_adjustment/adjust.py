"""Bundle adjustment: motion only, or motion and structure (thesis 2.8, 3.4)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vo.bundle_adjustment.joint import optimize_jointly
from vo.bundle_adjustment.point_estimates import PointEstimates, unknowns
from vo.bundle_adjustment.problem import TURN_LAST, Bundle, Optimum, as_cameras
from vo.bundle_adjustment.robust_covariance import camera_covariances, widened_covariance
from vo.bundle_adjustment.single_camera import refine_camera
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig


def optimize_reduced(
    bundle: Bundle, estimates: PointEstimates, settings: RefinementSettings, covariances: bool
) -> Optimum:
    """Solve the reduced camera system, with Huber weights that are renewed after the first step."""
    x, T = estimates, bundle.T_world_cam.copy()
    own = ~bundle.fixed[x.cameras]
    limits = settings.huber, settings.max_iterations
    found = optimize_jointly(as_cameras(T[x.cameras]), x.points, x.data, unknowns(own), *limits)
    x.points, x.weight = found.points, found.weights
    cameras = found.cameras
    T[x.cameras[own]] = se3.orthonormal(se3.pose(cameras.R[own], cameras.t[own]))
    return Optimum(T, found.information, found.cost, found.steps)


def optimize_factors(
    bundle: Bundle, estimates: PointEstimates, settings: RefinementSettings, covariances: bool
) -> Optimum:
    """Solve by GTSAM's factors; see `vo.bundle_adjustment.gtsam_backend`."""
    from vo.bundle_adjustment import gtsam_backend  # loads gtsam, a fifth of the start of a run

    return gtsam_backend.optimize_factors(bundle, estimates, settings, covariances)


BACKENDS = {"schur": optimize_reduced, "gtsam": optimize_factors}
"""Optimisers of cameras and points by `refinement.backend`.

Each takes a bundle, the estimates of its points, which it leaves at the solution, settings, and
whether the information is needed.
"""

MEDIAN_CHI2 = (1.386, 0.455)
"""Medians of chi-squared with two degrees of freedom, a pixel's, and with one, a disparity's."""


@dataclass(frozen=True)
class Refined:
    """Solution of a bundle.

    Attributes:
        T_world_cam: (K, 4, 4).
        points_world: (J, 3) metres.
        information: (J, 3, 3) of each point given the cameras.
        covariance: (K, 6, 6) of each camera given the fixed ones, by the measurements alone,
            tangent (v m, w rad) in its own frame; zero for those, and for all if it was not asked
            for.
        excess: (K,) variance by the scores of whole landmarks, over that of the covariance.
        iterations: Levenberg-Marquardt steps; the largest number allowed if it did not converge.
        error: Final value of half the summed robust squared whitened residuals.
        misfit: (2,) median squared residual of pixels and of disparities, over what their sigmas
            make one expect; 1 where they are right, NaN where there are none.
    """

    T_world_cam: Array
    points_world: Array
    information: Array
    covariance: Array
    excess: Array
    iterations: int
    error: float
    misfit: Array


@dataclass(frozen=True)
class Pose:
    """A camera (4, 4) refined on points that stay, and the Levenberg-Marquardt steps that it took.

    Information and products (6, 6), of tangents (w rad, v m), are those of `refine_camera`.
    """

    T_world_cam: Array
    iterations: int
    information: Array
    products: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance (6, 6), by the measurements alone, of tangents (v m, w rad) in its frame."""
        return widened_covariance(self.information, self.products)[TURN_LAST][:, TURN_LAST]


def refine_structure(
    bundle: Bundle, settings: RefinementSettings, covariances: bool = True
) -> Refined:
    """Minimise the reprojection error over all cameras that may move and all points.

    Every point should be seen by at least three cameras (thesis 4.4); this function takes what
    it is given. The covariances of K cameras cost K cubed.

    Source: thesis eq. 2.29 with a Huber loss; the gauge is held by the fixed cameras.
    """
    x = PointEstimates(bundle, settings.use_disparity)
    T, H, error, iterations = BACKENDS[settings.backend](bundle, x, settings, covariances)
    here, own = T[x.cameras], ~bundle.fixed[x.cameras]
    covariance, excess = np.zeros((len(T), 6, 6)), np.ones(len(T))
    if covariances and own.any():
        found, excess[x.cameras[own]] = camera_covariances(H, x.score_products(here, own))
        covariance[x.cameras[own]] = found[:, TURN_LAST][:, :, TURN_LAST]
    return Refined(
        T, x.points, x.information(here), covariance, excess, iterations, error, misfit(x, T)
    )


def misfit(estimates: PointEstimates, T: Array) -> Array:
    """Median squared residual of pixels and of disparities over what is expected, (2,)."""
    residuals, weight = estimates.residuals(T[estimates.cameras]), estimates.data.weight
    return _median_squares(residuals, weight) / MEDIAN_CHI2


@compiled()
def _median_squares(residuals: Array, weight: Array) -> Array:
    """Return median squares of residuals (M, 3): of pixels, and of disparities that weigh."""
    pixels, disparities = np.empty(len(residuals)), np.empty(len(residuals))
    known = 0
    for i in range(len(residuals)):
        u, v, d = residuals[i]
        pixels[i] = u * u + v * v
        if weight[i, 2] > 0:
            disparities[known] = d * d
            known += 1
    found = np.full(2, np.nan)
    if len(pixels) > 0:
        found[0] = np.median(pixels)
    if known > 0:
        found[1] = np.median(disparities[:known])
    return found


def refine_motion(
    T_world_cam: Array,
    points_world: Array,
    measured: Array,
    sigma: Array,
    rig: StereoRig,
    settings: RefinementSettings,
    spread_world: Array | None = None,
) -> Pose:
    """Minimise the reprojection error over one camera, from (4, 4), while the points (N, 3) stay.

    Measured are (N, 3) left-image u, v and disparity, pixels or NaN, with (N, 3) sigmas. The points
    are exact, or known to within a standard deviation along a vector, the spread (N, 3), metres.
    """
    f = np.array([rig.f_px, rig.f_px, rig.cx_px, rig.cy_px, rig.f_px * rig.baseline_m])
    points = np.ascontiguousarray(points_world, dtype=np.float64)
    limits = settings.huber, settings.max_iterations
    spread = np.zeros_like(points)
    if spread_world is not None:
        spread = np.ascontiguousarray(spread_world, dtype=np.float64)
    T, H, B, iterations = refine_camera(
        T_world_cam, points, spread, measured, sigma, settings.use_disparity, f, *limits
    )
    return Pose(T, iterations, H, B)
