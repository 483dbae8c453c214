"""The camera's pose from landmarks and how a new view sees them (thesis 2.6, 3.3, 4.1)."""

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.pose.absolute_orientation import HORN
from vo.pose.decoupled import split_motion
from vo.pose.graduated_nonconvexity import anneal
from vo.pose.hypotheses import Problem
from vo.pose.p3p import SOLVERS
from vo.pose.ransac import Consensus, consensus, ransac


def estimate_pose(
    points_odom: Array,
    rays: Array,
    points_cam: Array,
    settings: MotionSettings,
    rng: np.random.Generator,
    weights: Array | None = None,
    T_odom_guess: Array | None = None,
) -> Consensus | None:
    """Estimate T_odom_cam by `settings.method`.

    Args:
        points_odom: (N, 3) landmarks, metres.
        rays: (N, 2) normalised image coordinates (x / z, y / z) of the left camera.
        points_cam: (N, 3) metres, triangulated in the new view; NaN where it has no depth.
        settings: Method, solver, RANSAC's.
        rng: Draws the samples.
        weights: (N,) how much each match counts, if not all the same.
        T_odom_guess: (4, 4) expected pose, which only the methods `decoupled` and
            `graduated_nonconvexity` use; where odom is, if None.

    Returns:
        T_odom_cam, its inliers and covariance, or None if fewer than three matches can be used or
        all of them are degenerate. Absolute orientation uses the matches with depth, and only
        these can be its inliers.
    """
    absolute = settings.method == "absolute"
    usable = _finite(points_odom) & _finite(rays)
    if absolute:
        usable &= _finite(points_cam)
    metric = absolute and settings.residual == "distance"
    count = int(usable.sum())
    problem = Problem(
        points_odom=np.ascontiguousarray(points_odom[usable], dtype=np.float64),
        rays=np.ascontiguousarray(rays[usable], dtype=np.float64),
        points_cam=np.ascontiguousarray(points_cam[usable], dtype=np.float64),
        absolute=absolute,
        solver=HORN if absolute else SOLVERS[settings.solver],
        metric=metric,
        threshold=settings.threshold_m if metric else settings.threshold,
        inlier_cost=1.0 if settings.score == "msac" else 0.999 / max(count, 1),
        weights=np.ones(count) if weights is None else weights[usable].astype(np.float64),
    )
    T_guess = np.eye(4) if T_odom_guess is None else T_odom_guess
    if settings.method == "decoupled":
        outcome = _split(problem, T_guess, settings, rng)
    elif settings.method == "graduated_nonconvexity":
        outcome = _anneal(problem, T_guess, settings)
    else:
        outcome = ransac(problem, settings, rng)
    if outcome is None:
        return None
    agree = np.zeros(len(usable), dtype=np.bool_)
    agree[usable] = outcome.inliers
    return Consensus(outcome.T, agree, outcome.trials, outcome.covariance)


def _split(
    problem: Problem, T_odom_guess: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    trials = settings.max_hypotheses
    pose = split_motion(
        problem.points_odom, problem.rays, T_odom_guess, problem.threshold, trials, rng
    )
    return None if pose is None else _determined(consensus(problem, pose, trials, settings))


def _anneal(problem: Problem, T_odom_guess: Array, settings: MotionSettings) -> Consensus | None:
    # The expected motion repeats the last one: what that lacks of a rotation would grow.
    U, _, V = np.linalg.svd(T_odom_guess[:3, :3])
    T_odom_guess = se3.pose(U @ V, T_odom_guess[:3, 3])
    pose = np.ascontiguousarray(se3.inverse(T_odom_guess)[:3])
    known = len(problem.points_odom) > 0 and anneal(problem, pose)
    return _determined(consensus(problem, pose, 0, settings)) if known else None


def _determined(found: Consensus | None) -> Consensus | None:
    """A guess can make up for what a degenerate scene leaves open; that is no measurement."""
    return found if found and np.isfinite(found.covariance).all() else None


def relative_orientation(
    points_odom: Array,
    rays: Array,
    settings: MotionSettings,
    rng: np.random.Generator,
) -> Consensus | None:
    """Estimate T_odom_cam from landmarks and their left pixels, as `estimate_pose`."""
    relative = settings.model_copy(update={"method": "relative", "residual": "reprojection"})
    nowhere = np.full(np.shape(points_odom), np.nan)
    return estimate_pose(points_odom, rays, nowhere, relative, rng)


def reprojection_errors(T_odom_cam: Array, points_odom: Array, rays: Array) -> Array:
    """Distance in normalised image coordinates: (..., 4, 4), (N, 3), (N, 2) to (..., N).

    NaN for points that are not in front of the camera.
    """
    points_cam = se3.transform(se3.inverse(T_odom_cam), points_odom)
    z = points_cam[..., 2:]
    seen = np.divide(
        points_cam[..., :2], z, out=np.full_like(points_cam[..., :2], np.nan), where=z > 0
    )
    return np.linalg.norm(seen - rays, axis=-1)


def _finite(rows: Array) -> Mask:
    return np.asarray(np.isfinite(rows).all(axis=1))
