"""Pose by refinement of the expected one alone, under graduated non-convexity (F8).

Source: Sünderhauf, Konolige, Lacroix and Protzel, Visual odometry using sparse bundle adjustment
on an autonomous outdoor vehicle, 2006. A plain descent from the expected motion ends in curves at
the next best minimum; the loss of Geman and McClure, first so wide that it has no other minimum,
then ever narrower, does not: Yang, Antonante, Tzoumas and Carlone, Graduated non-convexity for
robust spatial perception, RA-L 2020.
"""

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array, copy_values
from vo.pose.gauss_newton import gauss_newton_step
from vo.pose.hypotheses import Problem, squared_errors
from vo.pose.ransac import Consensus, determined_consensus

FIRST_WIDTH = 2.0
"""Width of the first loss, in median errors of the guess."""

NARROWING = 1.4
"""Ratio of the width of one loss to that of the next."""

STEPS = 3
"""Gauss-Newton steps at each width."""


def refine_guess(
    problem: Problem, T_odom_guess: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    """Move the expected pose to where the matches have it, and refit it to its inliers."""
    # The expected motion repeats the last one: its deviation from a rotation would grow.
    R, _ = se3.nearest_rotation(T_odom_guess[:3, :3])
    pose = np.ascontiguousarray(se3.inverse(se3.pose(R, T_odom_guess[:3, 3]))[:3])
    if len(problem.points_odom) == 0 or not descend(problem, pose):
        return None
    return determined_consensus(problem, pose, settings)


def descend(problem: Problem, pose: Array) -> bool:
    """Minimise ever narrower losses of at least one match's reprojection error.

    A guessed pose (3, 4) changes in place; False if it is undetermined. The threshold comes last.
    """
    count = len(problem.points_odom)
    squares, moved = np.empty(count), np.empty((3, 4))
    squared_errors(problem, pose, 0, count, squares)
    width = FIRST_WIDTH * np.sqrt(np.median(squares))
    if not np.isfinite(width):
        return False
    while True:
        width = max(width, 1.0)
        for _ in range(STEPS):
            squared_errors(problem, pose, 0, count, squares)
            weights = problem.weights / (1 + squares / (width * width)) ** 2
            rows = np.flatnonzero(weights)
            if not gauss_newton_step(problem.points_odom, problem.rays, rows, pose, moved, weights):
                return False
            copy_values(moved, pose)
        if width == 1:
            return True
        width /= NARROWING
