"""Structure and motion by GTSAM's own stereo factors on poses and points.

Slower than the compiled elimination of `vo.bundle_adjustment.schur`, since each measurement
is a factor made from Python, and independent of it: projection, derivatives, robust loss and
elimination are GTSAM's (docs/decisions/0024).
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.bundle_adjustment.problem import Bundle, Optimum
from vo.bundle_adjustment.single_camera import RELATIVE_TOLERANCE
from vo.config import RefinementSettings

TO_STEREO = np.array([[1, 0, 0], [1, 0, -1], [0, 1, 0]])
"""From (u, v, disparity) to GTSAM's measurement (u left, u right, v)."""


def optimize_factors(
    bundle: Bundle, estimates: PointEstimates, settings: RefinementSettings, covariances: bool
) -> Optimum:
    """Minimise the Huber loss of a bundle over cameras and points.

    A point behind a camera that measured it counts as GTSAM's cheirality error has it: a constant
    residual without derivatives. One of `vo.bundle_adjustment.adjust.BACKENDS`; the cameras stay
    the initial ones if nothing determines them.
    """
    graph, values = factor_graph(bundle, settings), gtsam.Values()
    cameras, points = np.unique(bundle.camera), np.unique(bundle.point)
    for i in cameras:
        values.insert(X(i), gtsam.Pose3(bundle.T_world_cam[i]))
    for j in points:
        values.insert(L(j), bundle.points_world[j])
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(settings.max_iterations)
    parameters.setRelativeErrorTol(RELATIVE_TOLERANCE)
    parameters.setLinearSolverType("MULTIFRONTAL_QR")  # Cholesky rejects points of little parallax
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    try:
        values, iterations = optimizer.optimize(), optimizer.iterations()
    except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own here
        iterations = settings.max_iterations
    T_world_cam, points_world = bundle.T_world_cam.copy(), bundle.points_world.astype(np.float64)
    for i in cameras[~bundle.fixed[cameras]]:
        T_world_cam[i] = values.atPose3(X(i)).matrix()
    for j in points:
        points_world[j] = values.atPoint3(L(j))
    estimates.points = points_world
    here, moving = T_world_cam[estimates.cameras], ~bundle.fixed[estimates.cameras]
    estimates.reweight(here, settings.huber)
    H, _, error = estimates.linearize(here, moving, derivatives=covariances)
    return Optimum(T_world_cam, H, error, iterations)


def factor_graph(bundle: Bundle, settings: RefinementSettings) -> gtsam.NonlinearFactorGraph:
    """Make a factor of every measurement, and hold the fixed cameras.

    A measurement is a stereo factor, or a projection into the left camera where the disparity is
    unknown or not used. The Huber loss is of the norm of a measurement's whole residual, in sigmas.
    """
    fx, fy, cx, cy = bundle.K[0, 0], bundle.K[1, 1], bundle.K[0, 2], bundle.K[1, 2]
    pair = gtsam.Cal3_S2Stereo(fx, fy, 0.0, cx, cy, bundle.baseline_m)
    left = gtsam.Cal3_S2(fx, fy, 0.0, cx, cy)
    loss = gtsam.noiseModel.mEstimator.Huber.Create(settings.huber)
    graph = gtsam.NonlinearFactorGraph()
    for i in np.unique(bundle.camera[bundle.fixed[bundle.camera]]):
        graph.add(gtsam.NonlinearEqualityPose3(X(i), gtsam.Pose3(bundle.T_world_cam[i])))
    stereo = ~np.isnan(bundle.measured[:, 2]) & settings.use_disparity
    measured = np.where(stereo[:, None], bundle.measured @ TO_STEREO.T, bundle.measured)
    covariance = np.einsum("ij,mj,kj->mik", TO_STEREO, bundle.sigma**2, TO_STEREO)
    for m in range(len(measured)):
        keys = X(bundle.camera[m]), L(bundle.point[m])
        if stereo[m]:
            noise = gtsam.noiseModel.Gaussian.Covariance(covariance[m])
            noise = gtsam.noiseModel.Robust.Create(loss, noise)
            pixels = gtsam.StereoPoint2(*measured[m])
            graph.add(gtsam.GenericStereoFactor3D(pixels, noise, *keys, pair))
        else:
            noise = gtsam.noiseModel.Diagonal.Sigmas(bundle.sigma[m, :2])
            noise = gtsam.noiseModel.Robust.Create(loss, noise)
            graph.add(gtsam.GenericProjectionFactorCal3_S2(measured[m, :2], noise, *keys, left))
    return graph
