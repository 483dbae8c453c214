"""Pose of the camera from landmarks and their pixels in a new view (thesis 2.6, 3.3, 4.1)."""

from collections.abc import Callable

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.pose.decoupled import estimate_decoupled
from vo.pose.graduated_nonconvexity import refine_guess
from vo.pose.hypotheses import Problem
from vo.pose.p3p import SOLVERS
from vo.pose.ransac import Consensus, ransac

Method = Callable[[Problem, Array, MotionSettings, np.random.Generator], Consensus | None]
METHODS: dict[str, Method] = {
    "relative": ransac,
    "absolute": ransac,
    "decoupled": estimate_decoupled,
    "graduated_nonconvexity": refine_guess,
}
"""Estimators of the pose, by `motion.method`.

Each takes N matches, all finite, the expected T_odom_cam (4, 4), settings and a source of random
numbers, which not all of them use. They return None if the matches do not determine the pose.
"""


def estimate_pose(
    points_odom: Array,
    rays: Array,
    points_cam: Array,
    settings: MotionSettings,
    rng: np.random.Generator,
    weights: Array | None = None,
    T_odom_guess: Array | None = None,
) -> Consensus | None:
    """Estimate T_odom_cam from matches, of which many may be false, by `settings.method`.

    None if fewer than three matches can be used or all of them are degenerate. Absolute orientation
    uses the matches with depth, and only these can be its inliers.

    Args:
        points_odom: (N, 3) landmarks, metres.
        rays: (N, 2) normalised image coordinates (x / z, y / z) of the left camera.
        points_cam: (N, 3) metres, triangulated in the new view; NaN without a depth.
        settings: Method, solver and parameters of RANSAC.
        rng: Draws the samples.
        weights: (N,) weight of each match; all one by default.
        T_odom_guess: (4, 4) expected pose, the identity by default; RANSAC does not use it.
    """
    absolute = settings.method == "absolute"
    needed = (points_odom, rays, points_cam) if absolute else (points_odom, rays)
    usable = np.logical_and.reduce([np.isfinite(x).all(axis=1) for x in needed])
    metric = absolute and settings.residual == "distance"
    count = int(usable.sum())
    problem = Problem(
        points_odom=np.ascontiguousarray(points_odom[usable], dtype=np.float64),
        rays=np.ascontiguousarray(rays[usable], dtype=np.float64),
        points_cam=np.ascontiguousarray(points_cam[usable], dtype=np.float64),
        absolute=absolute,
        solver=SOLVERS[settings.solver],
        metric=metric,
        threshold=settings.threshold_m if metric else settings.threshold,
        inlier_cost=1.0 if settings.score == "msac" else 0.999 / max(count, 1),
        weights=np.ones(count) if weights is None else weights[usable].astype(np.float64),
    )
    T_guess = np.eye(4) if T_odom_guess is None else T_odom_guess
    found = METHODS[settings.method](problem, T_guess, settings, rng)
    if found is None:
        return None
    inliers = np.zeros(len(usable), dtype=np.bool_)
    inliers[usable] = found.inliers
    return Consensus(found.T_odom_cam, inliers)


def reprojection_errors(T_odom_cam: Array, points_odom: Array, rays: Array) -> Array:
    """Measure distances in normalised image coordinates: (..., 4, 4), (N, 3), (N, 2) to (..., N).

    NaN for points that are not in front of the camera.
    """
    points_cam = se3.transform(se3.inverse(T_odom_cam), points_odom)
    z = points_cam[..., 2:]
    seen = np.divide(
        points_cam[..., :2], z, out=np.full_like(points_cam[..., :2], np.nan), where=z > 0
    )
    return np.linalg.norm(seen - rays, axis=-1)
