"""Bundle adjustment in GTSAM: motion only, or motion and structure (thesis 2.8, 3.4).

The only module that imports gtsam, whose Pose3 tangents are (w, v); covariances leave it in the
project's order. All measurements of a bundle
are one factor on its cameras, from which `vo.reduction` has eliminated the points: GTSAM then
solves for tens of unknowns, and Python is entered once an iteration instead of once a measurement
(docs/decisions/0006).
"""

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from vo.config import RefinementSettings
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig
from vo.reduction import all_residuals, camera_normal, reduce, robust_weights

REWEIGHTINGS = 3
"""Rounds in which the Huber weights are renewed (Holland and Welsch, 1977), for one camera."""

STRUCTURE_REWEIGHTINGS = 2
"""The same for many, which were refined before."""

LIFT = 1e-9
"""Added to the diagonal of normal equations, relative: directions that nothing determines stay."""


Normal = Callable[[Array, bool], tuple[Array, Array, float]]

TURN_LAST = [3, 4, 5, 0, 1, 2]
"""From GTSAM's tangents (w, v) to (v, w)."""

MEDIAN_CHI2 = (0.455, 1.386)
"""Medians of chi-squared with one and two degrees of freedom."""


@dataclass(frozen=True)
class Bundle:
    """Cameras, points and what the cameras measured.

    Attributes:
        T_world_cam: (K, 4, 4) initial poses.
        points_world: (J, 3) initial points, metres.
        camera: (M,) index of the camera of each measurement.
        point: (M,) index of the point of each measurement.
        measured: (M, 3) left-image u, v and disparity, pixels; NaN where not measured.
        sigma: (M, 3) their standard deviations, pixels.
        fixed: (K,) cameras that must not move; at least one.
        K: (3, 3) pinhole matrix without skew.
        baseline_m: Of the stereo pair.
    """

    T_world_cam: Array
    points_world: Array
    camera: Indices
    point: Indices
    measured: Array
    sigma: Array
    fixed: Mask
    K: Array
    baseline_m: float


@dataclass(frozen=True)
class Refined:
    """A bundle's solution.

    Attributes:
        T_world_cam: (K, 4, 4).
        points_world: (J, 3) metres.
        covariance: (K, 6, 6) of each camera given the fixed ones, tangent (v m, w rad) in its own
            frame; zero for those.
        iterations: Levenberg–Marquardt steps; `most_iterations` if it did not converge.
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
    """A camera refined on points that stay.

    Attributes:
        T_world_cam: (4, 4).
        covariance: (6, 6) tangent (v m, w rad) in the camera's frame; of the measurements alone.
        iterations: Levenberg–Marquardt steps.
    """

    T_world_cam: Array
    covariance: Array
    iterations: int


def refine_structure(bundle: Bundle, settings: RefinementSettings) -> Refined:
    """Minimise the reprojection error over all cameras that may move and all points.

    Every point should be seen by at least three cameras (thesis 4.4); this function takes what
    it is given.

    Source:
        thesis eq. 2.29 with a Huber loss; the gauge is held by the fixed cameras.
    """
    order = np.argsort(bundle.point, kind="stable")
    camera, point = bundle.camera[order], bundle.point[order]
    measured, known = _weighted(bundle.measured[order], bundle.sigma[order])
    intrinsics = _intrinsics(bundle.K, bundle.baseline_m)
    first = np.searchsorted(point, np.arange(len(bundle.points_world) + 1))
    moving = np.flatnonzero(~bundle.fixed)
    slot = np.full(len(bundle.fixed), -1)
    slot[moving] = np.arange(len(moving))
    T, points, weight = bundle.T_world_cam.copy(), bundle.points_world.copy(), known

    nowhere = np.full_like(slot, -1)

    def normal(poses: Array, derivatives: bool) -> tuple[Array, Array, float]:
        nonlocal points
        T[moving] = poses
        places, size = (slot, len(moving)) if derivatives else (nowhere, 0)
        H, g, cost, points = reduce(
            *_split(T), points, first, camera, measured, weight, intrinsics, places, size
        )
        return H, g, cost

    poses, iterations = T[moving], 0
    for _ in range(STRUCTURE_REWEIGHTINGS):
        weight = robust_weights(
            *_split(T), points, camera, point, measured, known, intrinsics, settings.huber
        )
        poses, steps = _optimize(poses, normal, settings)
        iterations += steps
        if steps >= settings.most_iterations:
            break
    H, _, error = normal(poses, derivatives=True)
    covariance = np.zeros((len(T), 6, 6))
    covariance[moving] = _diagonal_blocks(_inverse(H))[:, TURN_LAST][:, :, TURN_LAST]
    residuals = all_residuals(*_split(T), points, camera, point, measured, known, intrinsics)
    return Refined(T, points, covariance, iterations, error, _misfit(residuals, known))


def refine_motion(
    T_world_cam: Array,
    points_world: Array,
    measured: Array,
    sigma: Array,
    rig: StereoRig,
    settings: RefinementSettings,
) -> Pose:
    """Minimise the reprojection error over one camera, the points staying as they are.

    Args:
        T_world_cam: (4, 4) initial pose.
        points_world: (N, 3) metres.
        measured: (N, 3) left-image u, v and disparity, pixels; NaN where not measured.
        sigma: (N, 3) their standard deviations.
        rig: Projects.
        settings: Loss and iterations.
    """
    seen, known = _weighted(measured, sigma)
    points = np.ascontiguousarray(points_world, dtype=np.float64)
    intrinsics = _intrinsics(rig.K, rig.baseline_m)
    everyone = np.arange(len(points))
    poses, weight, iterations = T_world_cam[None], known, 0

    def normal(poses: Array, derivatives: bool = True) -> tuple[Array, Array, float]:
        R, t = _split(poses)
        return camera_normal(R[0], t[0], points, seen, weight, intrinsics)

    for _ in range(REWEIGHTINGS if len(points) else 0):
        weight = robust_weights(
            *_split(poses), points, 0 * everyone, everyone, seen, known, intrinsics, settings.huber
        )
        poses, more = _optimize(poses, normal, settings)
        iterations += more
    covariance = _inverse(normal(poses)[0])[TURN_LAST][:, TURN_LAST]
    return Pose(poses[0], covariance, iterations)


def _optimize(poses: Array, normal: Normal, s: RefinementSettings) -> tuple[Array, int]:
    """Levenberg–Marquardt over one factor that is given by its normal equations.

    Args:
        poses: (S, 4, 4) where to start.
        normal: Poses to (6 S, 6 S) information H, (6 S,) gradient g and cost f, of which H and g
            may be anything where no derivatives are asked for. The factor's residuals e and
            derivatives J are any with J'J = H, J'e = g and e'e = 2 f.
        s: Iterations.

    Returns:
        (S, 4, 4) poses and the steps taken; the poses as given if nothing determines them.
    """
    keys = [X(i) for i in range(len(poses))]
    size = 6 * len(poses)

    def residuals(_: object, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        here = np.array([values.atPose3(key).matrix() for key in keys])
        H, g, cost = normal(here, jacobians is not None)
        e = np.zeros(size + 1)
        if jacobians is None:
            e[-1] = np.sqrt(2 * cost)
            return e
        L = _cholesky(H)
        e[:-1] = np.linalg.solve(L, g)
        e[-1] = np.sqrt(max(2 * cost - e @ e, 0.0))
        J = np.vstack([L.T, np.zeros(size)])
        for i in range(len(keys)):
            jacobians[i] = np.asfortranarray(J[:, 6 * i : 6 * i + 6])
        return e

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, T in zip(keys, poses, strict=True):
        values.insert(key, gtsam.Pose3(T))
    graph.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(size + 1), keys, residuals))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(s.most_iterations)
    parameters.setRelativeErrorTol(1e-4)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    try:
        values = optimizer.optimize()
    except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own here
        return poses, s.most_iterations
    return np.array([values.atPose3(key).matrix() for key in keys]), optimizer.iterations()


def _misfit(residuals: Array, weight: Array) -> Array:
    pixels = (residuals[:, :2] ** 2).sum(axis=1)
    disparities = residuals[weight[:, 2] > 0, 2] ** 2
    return np.array(
        [
            np.median(squared) / MEDIAN_CHI2[k] if len(squared) else np.nan
            for squared, k in ((pixels, 1), (disparities, 0))
        ]
    )


def _weighted(measured: Array, sigma: Array) -> tuple[Array, Array]:
    """Measurements without NaN, and one over their sigmas, zero where nothing was measured."""
    weight = np.where(np.isnan(measured), 0.0, 1.0 / sigma)
    return np.nan_to_num(measured), weight


def _intrinsics(K: Array, baseline_m: float) -> Array:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 0] * baseline_m])


def _split(T: Array) -> tuple[Array, Array]:
    return np.ascontiguousarray(T[:, :3, :3]), np.ascontiguousarray(T[:, :3, 3])


def _lifted(H: Array) -> Array:
    return H + np.diag(LIFT * np.diag(H) + 1e-12)


def _cholesky(H: Array) -> Array:
    try:
        return np.linalg.cholesky(_lifted(H))
    except np.linalg.LinAlgError:  # rounding made it indefinite
        values, vectors = np.linalg.eigh(_lifted(H))
        return vectors * np.sqrt(np.maximum(values, 0.0))


def _inverse(H: Array) -> Array:
    return np.linalg.inv(_lifted(H))


def _diagonal_blocks(matrix: Array) -> Array:
    n = len(matrix) // 6
    return matrix.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n)]
