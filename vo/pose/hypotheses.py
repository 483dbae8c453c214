"""Hypotheses of the camera's pose: sampled, proposed, scored, refitted (thesis 2.6, 2.7).

Poses are (3, 4) [R | t] with p_cam = R @ p_odom + t.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices, copy_values
from vo.contract.compilation import compiled
from vo.pose.absolute_orientation import absolute_orientation
from vo.pose.gauss_newton import gauss_newton_step
from vo.pose.p3p import is_collinear, p3p

SAMPLE = 3
"""Matches of a minimal sample."""

MAX_POSES = 4
"""Largest number of poses that one sample gives."""

FIRST_REACH = 3.0
"""Thresholds within which the first refit takes inliers; each next one halves it, down to one."""

BLOCK = 16
"""Matches scored at a time before a bad pose is given up."""


class Problem(NamedTuple):
    """Matches between landmarks and a new view, and how a pose is scored by them.

    Attributes:
        points_odom: (N, 3) metres.
        rays: (N, 2) normalised image coordinates.
        points_cam: (N, 3) metres, triangulated in the new view; used if `absolute`.
        absolute: Orient points to points, not to rays.
        solver: A value of `vo.pose.p3p.SOLVERS`; not used if absolute.
        metric: Score by the distance between points, metres, not by reprojection.
        threshold: Largest error of an inlier, in metres if metric, else normalised.
        inlier_cost: Cost of an inlier at the threshold; that of an outlier is 1. One for MSAC
            (Torr and Zisserman, CVIU 2000); for a count, so little that it only breaks ties.
        weights: (N,) weight of each match, not negative.
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


@compiled()
def cumulative_weights(weights: Array) -> Array:
    """Sum the weights before each of N matches, and all of them: (N + 1,)."""
    bounds = np.zeros(len(weights) + 1)
    for k in range(len(weights)):
        bounds[k + 1] = bounds[k] + weights[k]
    return bounds


@compiled()
def draw_sample(numbers: Array, bounds: Array, sample: Indices) -> None:
    """Write three different rows, each drawn in proportion to its weight.

    The numbers (3,) are uniform in [0, 1), the bounds (N + 1,) from `cumulative_weights`.
    """
    in_order = np.empty(SAMPLE, np.int64)
    for k in range(SAMPLE):
        left = bounds[-1]
        taken = in_order[:k]
        for row in taken:
            left -= bounds[row + 1] - bounds[row]
        place = numbers[k] * left
        for row in taken:  # step over the rows that are taken
            if place >= bounds[row]:
                place += bounds[row + 1] - bounds[row]
        row = np.searchsorted(bounds, place, side="right") - 1
        sample[k] = row = min(row, len(bounds) - 2)
        while k > 0 and in_order[k - 1] > row:
            in_order[k] = in_order[k - 1]
            k -= 1
        in_order[k] = row


@compiled()
def propose(problem: Problem, sample: Indices, poses: Array) -> int:
    """Write the poses (4, 3, 4) that a sample (3,) of matches allows; return their number."""
    if problem.absolute:
        points_odom, points_cam = problem.points_odom[sample], problem.points_cam[sample]
        if is_collinear(points_odom) or is_collinear(points_cam):
            return 0
        return int(absolute_orientation(points_cam, points_odom, np.arange(SAMPLE), poses[0]))
    points_odom, rays_cam = np.empty((SAMPLE, 3)), np.empty((SAMPLE, 3))
    for k in range(SAMPLE):
        u, v = problem.rays[sample[k]]
        length = np.sqrt(u**2 + v**2 + 1.0)
        rays_cam[k, 0], rays_cam[k, 1], rays_cam[k, 2] = u / length, v / length, 1.0 / length
        copy_values(problem.points_odom[sample[k]], points_odom[k])
    return p3p(points_odom, rays_cam, problem.solver, poses)


@compiled()
def squared_errors(problem: Problem, pose: Array, first: int, last: int, out: Array) -> None:
    """Write the squared errors of a range of matches over the squared threshold into (B,).

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


@compiled()
def cost(problem: Problem, pose: Array, first: int, last: int, bail: float) -> float:
    """Sum the cost of a range of matches; infinite as soon as it cannot fall below `bail`."""
    total = 0.0
    errors = np.empty(BLOCK)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        squared_errors(problem, pose, start, end, errors)
        for k in range(end - start):
            one = problem.inlier_cost * errors[k] if errors[k] < 1 else 1.0
            total += problem.weights[start + k] * one
        if total >= bail:
            return np.inf
    return total


@compiled()
def inlier_rows(problem: Problem, pose: Array, reach: float = 1.0) -> Indices:
    """Find the rows (K,) of the matches within `reach` thresholds."""
    errors = np.empty(len(problem.points_odom))
    squared_errors(problem, pose, 0, len(errors), errors)
    return np.flatnonzero(errors < reach * reach)


@compiled()
def refit(problem: Problem, pose: Array, now: float, iterations: int) -> float:
    """Refit a pose (3, 4), in place, to its inliers while its cost falls; return the cost.

    The first iterations reach further: a pose from three noisy points misses inliers (iterative
    least squares with a threshold that shrinks: Chum, Matas and Kittler, DAGM 2003).
    """
    refitted = np.empty((3, 4))
    for k in range(iterations):
        reach = max(FIRST_REACH / 2**k, 1.0)
        rows = inlier_rows(problem, pose, reach)
        if len(rows) < SAMPLE:
            break
        if problem.absolute:
            done = absolute_orientation(problem.points_cam, problem.points_odom, rows, refitted)
        else:
            done = gauss_newton_step(problem.points_odom, problem.rays, rows, pose, refitted)
        if not done:
            break
        then = cost(problem, refitted, 0, len(problem.points_odom), now)
        if then < now:
            copy_values(refitted, pose)
            now = then
        elif reach == 1:
            break
    return now
