"""Bundle adjustment in GTSAM: motion only, or motion and structure (thesis 2.8, 3.4).

The only module that imports gtsam, whose Pose3 tangents are (w, v).
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig

NEAREST_M = 1e-3
"""Points are kept this far in front of a camera while a pose is tried."""

REWEIGHTINGS = 3
"""Rounds in which the motion's Huber weights are renewed (Holland and Welsch, 1977)."""


@dataclass(frozen=True)
class Bundle:
    """Cameras, points and what the cameras measured.

    Attributes:
        T_world_cam: (K, 4, 4) initial poses.
        points_world: (J, 3) initial points, metres.
        camera: (M,) index of the camera of each measurement.
        point: (M,) index of the point of each measurement.
        pixels: (M, 2) left-image (u, v).
        disparity_px: (M,) NaN where only the left eye measured.
        fixed: (K,) cameras that must not move; at least one.
        K: (3, 3) pinhole matrix.
        baseline_m: Of the stereo pair.
    """

    T_world_cam: Array
    points_world: Array
    camera: Indices
    point: Indices
    pixels: Array
    disparity_px: Array
    fixed: Mask
    K: Array
    baseline_m: float


@dataclass(frozen=True)
class Refined:
    """A bundle's solution.

    Attributes:
        T_world_cam: (K, 4, 4).
        points_world: (J, 3) metres.
        iterations: Levenberg–Marquardt steps; `most_iterations` if it did not converge.
        error: Final value of half the summed robust squared whitened residuals.
    """

    T_world_cam: Array
    points_world: Array
    iterations: int
    error: float


def refine_structure(bundle: Bundle, settings: RefinementSettings) -> Refined:
    """Minimise the reprojection error over all cameras that may move and all points.

    Every point should be seen by at least three cameras (thesis 4.4); this function takes what
    it is given.

    Source:
        thesis eq. 2.29 with a Huber loss; the gauge is held by the fixed cameras.
    """
    K = bundle.K
    intrinsics = (K[0, 0], K[1, 1], K[0, 1], K[0, 2], K[1, 2])
    stereo, mono = gtsam.Cal3_S2Stereo(*intrinsics, bundle.baseline_m), gtsam.Cal3_S2(*intrinsics)
    stereo_noise, mono_noise = _noise(settings)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, T in enumerate(bundle.T_world_cam):
        values.insert(X(i), gtsam.Pose3(T))
        if bundle.fixed[i]:
            graph.add(gtsam.NonlinearEqualityPose3(X(i), gtsam.Pose3(T)))
    for j, point in enumerate(bundle.points_world):
        values.insert(L(j), point)
    for i, j, (u, v), d in zip(
        bundle.camera, bundle.point, bundle.pixels, bundle.disparity_px, strict=True
    ):
        if np.isnan(d):
            graph.add(
                gtsam.GenericProjectionFactorCal3_S2(np.array([u, v]), mono_noise, X(i), L(j), mono)
            )
        else:
            measured = gtsam.StereoPoint2(u, u - d, v)
            graph.add(gtsam.GenericStereoFactor3D(measured, stereo_noise, X(i), L(j), stereo))
    values, iterations = _optimize(graph, values, settings)
    return Refined(
        np.array([values.atPose3(X(i)).matrix() for i in range(len(bundle.T_world_cam))]),
        np.array([values.atPoint3(L(j)) for j in range(len(bundle.points_world))]).reshape(-1, 3),
        iterations,
        graph.error(values),
    )


def refine_motion(
    T_world_cam: Array,
    points_world: Array,
    pixels: Array,
    disparity_px: Array,
    rig: StereoRig,
    settings: RefinementSettings,
) -> tuple[Array, int]:
    """Minimise the reprojection error over one camera, the points staying as they are.

    Args:
        T_world_cam: (4, 4) initial pose.
        points_world: (N, 3) metres.
        pixels: (N, 2) left-image (u, v).
        disparity_px: (N,) NaN where only the left eye measured.
        rig: Projects.
        settings: Noise, loss and iterations.

    Returns:
        (4, 4) refined T_world_cam and the number of iterations.
    """
    measured = np.column_stack([pixels, disparity_px])
    sigma = np.array([settings.sigma_px, settings.sigma_px, settings.sigma_disparity_px])
    known = np.where(np.isnan(measured), 0.0, 1.0 / sigma)
    measured = np.nan_to_num(measured)
    f = rig.f_px * np.array([1.0, 1.0, rig.baseline_m])
    c = np.array([rig.cx_px, rig.cy_px, 0.0])
    weight = known

    def whitened(_: object, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        # One factor for all points: residuals and derivatives in a few array products.
        T = values.atPose3(X(0))
        p = (points_world - T.translation()) @ T.rotation().matrix()  # points_cam
        z = np.maximum(p[:, 2], NEAREST_M)
        q = np.column_stack([p[:, :2], np.ones(len(p))]) / z[:, None]  # (x / z, y / z, 1 / z)
        if jacobians is not None:
            dq = np.zeros((len(p), 3, 3))
            dq[:, 0, 0] = dq[:, 1, 1] = 1 / z
            dq[:, :, 2] = -q / z[:, None]
            dp = np.concatenate([se3.skew(p), np.broadcast_to(-np.eye(3), (len(p), 3, 3))], axis=2)
            jacobians[0] = np.asfortranarray(((weight * f)[..., None] * (dq @ dp)).reshape(-1, 6))
        return (weight * (f * q + c - measured)).ravel()

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(X(0), gtsam.Pose3(T_world_cam))
    noise = gtsam.noiseModel.Unit.Create(3 * len(points_world))
    graph.add(gtsam.CustomFactor(noise, [X(0)], whitened))
    iterations = 0
    for _ in range(REWEIGHTINGS):
        weight = known
        residual = np.linalg.norm(whitened(None, values, None).reshape(-1, 3), axis=1)
        weight = known * np.sqrt(settings.huber / np.maximum(residual, settings.huber))[:, None]
        values, more = _optimize(graph, values, settings)
        iterations += more
    return values.atPose3(X(0)).matrix(), iterations


def _noise(settings: RefinementSettings) -> tuple[gtsam.noiseModel.Base, gtsam.noiseModel.Base]:
    """Noise of (u_left, u_right, v) and of (u, v).

    u_right = u_left - d inherits the error of u_left, so the two are correlated.
    """
    s2, d2 = settings.sigma_px**2, settings.sigma_disparity_px**2
    covariance = np.array([[s2, s2, 0], [s2, s2 + d2, 0], [0, 0, s2]])
    huber = gtsam.noiseModel.mEstimator.Huber.Create(settings.huber)
    robust = gtsam.noiseModel.Robust.Create
    return (
        robust(huber, gtsam.noiseModel.Gaussian.Covariance(covariance)),
        robust(huber, gtsam.noiseModel.Isotropic.Sigma(2, settings.sigma_px)),
    )


def _optimize(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, settings: RefinementSettings
) -> tuple[gtsam.Values, int]:
    """Levenberg–Marquardt: the solution and its iterations.

    A system that does not determine its unknowns leaves them as they were, and counts as not
    converged.
    """
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(settings.most_iterations)
    parameters.setRelativeErrorTol(1e-5)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    try:
        return optimizer.optimize(), optimizer.iterations()
    except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own here
        return values, settings.most_iterations
