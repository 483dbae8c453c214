"""What RANSAC asks of a model of the camera's motion: propose, judge, refit (thesis 2.6, 2.7).

Poses are (3, 4) [R | t] with p_cam = R @ p_odom + t.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.pose.absolute_orientation import orient
from vo.pose.gauss_newton import step
from vo.pose.p3p import MOST_CANDIDATES, p3p, slender
from vo.pose.pose_covariance import covariance, covariance_of_points

SAMPLE = 3
MOST_POSES = 4
"""That one sample may give."""

WIDEST = 3.0
"""Thresholds within which the first refit looks for inliers; each next one within half as many."""

BLOCK = 16
"""Matches judged at a time before a bad pose is given up."""


class Problem(NamedTuple):
    """Matches between landmarks and a new view, and how to judge a pose by them.

    Attributes:
        points_odom: (N, 3) metres.
        rays: (N, 2) normalised image coordinates.
        points_cam: (N, 3) metres, triangulated in the new view; used if `absolute`.
        absolute: Orient points to points, not to rays.
        solver: A value of `ABSOLUTE_SOLVERS` if absolute, else of `SOLVERS`.
        metric: Judge by the distance between points, metres, not by reprojection.
        threshold: Largest error of an inlier, in metres if metric, else normalised.
        inlier_cost: Cost of an inlier at the threshold; that of an outlier is 1. One for MSAC
            (Torr and Zisserman, CVIU 2000); for a count, so little that it only breaks ties.
        weights: (N,) how much each match counts, not negative.
    """

    points_odom: Array
    rays: Array
    points_cam: Array
    absolute: bool
    solver: int
    metric: bool
    threshold: float
    inlier_cost: float
    weights: Array


@compiled(error_model="numpy")
def propose(problem: Problem, sample: Indices, poses: Array) -> int:
    """Write the poses (4, 3, 4) that a sample of three allows; returns how many."""
    if problem.absolute:
        points_odom, points_cam = problem.points_odom[sample], problem.points_cam[sample]
        if slender(points_odom) or slender(points_cam):
            return 0
        return int(orient(points_cam, points_odom, np.arange(SAMPLE), problem.solver, poses[0]))
    rays_cam = np.ones((SAMPLE, 3))
    for k in range(SAMPLE):
        rays_cam[k, :2] = problem.rays[sample[k]]
        rays_cam[k] /= np.sqrt((rays_cam[k] ** 2).sum())
    legs = np.empty((MOST_CANDIDATES, 3))
    return p3p(problem.points_odom[sample], rays_cam, problem.solver, legs, poses)


@compiled(error_model="numpy")
def misfits(problem: Problem, pose: Array, first: int, last: int, out: Array) -> None:
    """Write the squared errors of a range of matches over the squared threshold.

    Infinite for a point that is not in front of the camera.
    """
    X, r, q = problem.points_odom, problem.rays, problem.points_cam
    r00, r01, r02, tx = pose[0]
    r10, r11, r12, ty = pose[1]
    r20, r21, r22, tz = pose[2]
    scale = 1 / problem.threshold**2
    for k in range(first, last):
        x = r00 * X[k, 0] + r01 * X[k, 1] + r02 * X[k, 2] + tx
        y = r10 * X[k, 0] + r11 * X[k, 1] + r12 * X[k, 2] + ty
        z = r20 * X[k, 0] + r21 * X[k, 1] + r22 * X[k, 2] + tz
        if problem.metric:
            error2 = (x - q[k, 0]) ** 2 + (y - q[k, 1]) ** 2 + (z - q[k, 2]) ** 2
        else:
            inverse_z = 1 / z if z > 0 else np.inf
            error2 = (x * inverse_z - r[k, 0]) ** 2 + (y * inverse_z - r[k, 1]) ** 2
        out[k - first] = scale * error2 if z > 0 else np.inf


@compiled(error_model="numpy")
def cost(problem: Problem, pose: Array, first: int, last: int, bail: float) -> float:
    """Summed cost of a range of the matches; infinite as soon as it cannot fall below `bail`."""
    total = 0.0
    some = np.empty(BLOCK)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        misfits(problem, pose, start, end, some)
        for k in range(end - start):
            one = problem.inlier_cost * some[k] if some[k] < 1 else 1.0
            total += problem.weights[start + k] * one
        if total >= bail:
            return np.inf
    return total


@compiled(error_model="numpy")
def inliers(problem: Problem, pose: Array, reach: float = 1.0) -> Indices:
    """Rows of the matches within so many thresholds."""
    all_of_them = np.empty(len(problem.points_odom))
    misfits(problem, pose, 0, len(all_of_them), all_of_them)
    return np.flatnonzero(all_of_them < reach * reach)


@compiled(error_model="numpy")
def improve(problem: Problem, pose: Array, now: float, rounds: int) -> float:
    """Refit a pose (3, 4), in place, to its inliers while its cost falls; returns the cost.

    The first rounds reach further, to catch what a pose from three noisy points has missed.

    Source:
        Chum, Matas and Kittler, Locally optimized RANSAC, DAGM 2003: iterative least squares
        with a threshold that shrinks.
    """
    refitted = np.empty((3, 4))
    for k in range(rounds):
        reach = max(WIDEST / 2**k, 1.0)
        rows = inliers(problem, pose, reach)
        if len(rows) < SAMPLE:
            break
        if problem.absolute:
            solver = problem.solver
            done = orient(problem.points_cam, problem.points_odom, rows, solver, refitted)
        else:
            done = step(problem.points_odom, problem.rays, rows, pose, refitted)
        if not done:
            break
        then = cost(problem, refitted, 0, len(problem.points_odom), now)
        if then < now:
            pose[:], now = refitted, then
        elif reach == 1:
            break
    return now


@compiled(error_model="numpy")
def uncertainty(problem: Problem, pose: Array, rows: Indices) -> Array:
    """Covariance (6, 6) of the pose that fits some inliers best; tangent order (w, v)."""
    if problem.absolute:
        return covariance_of_points(problem.points_odom, problem.points_cam, rows, pose)
    return covariance(problem.points_odom, problem.rays, rows, pose)
