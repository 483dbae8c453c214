"""The camera's motion by refinement alone, all matches at hand and no motion known before (F8).

Source: Sünderhauf, Konolige, Lacroix and Protzel, Visual odometry using sparse bundle adjustment
on an autonomous outdoor vehicle, 2006. A plain descent from the expected motion ends in curves at
the next best minimum; the loss of Geman and McClure, first so wide that it has no other minimum,
then ever narrower, does not: Yang, Antonante, Tzoumas and Carlone, Graduated non-convexity for
robust spatial perception, RA-L 2020.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.pose.gauss_newton import step
from vo.pose.hypotheses import Problem, misfits

FIRST = 2.0
"""Width of the first loss, in median errors of the guess."""

NARROWING = 1.4
STEPS = 3
"""Of Gauss-Newton at each width."""


@compiled(error_model="numpy")
def anneal(problem: Problem, pose: Array) -> bool:
    """Move a guessed pose (3, 4), in place, to where the matches have it.

    Args:
        problem: At least one match; judged by reprojection, whose threshold is the last width.
        pose: (3, 4) [R | t] with p_cam = R @ p_odom + t.

    Returns:
        False if the matches do not determine the pose.
    """
    count = len(problem.points_odom)
    squares, weights, moved = np.empty(count), np.empty(count), np.empty((3, 4))
    misfits(problem, pose, 0, count, squares)
    width = FIRST * np.sqrt(np.median(squares))
    if not np.isfinite(width):
        return False
    while True:
        width = max(width, 1.0)
        for _ in range(STEPS):
            misfits(problem, pose, 0, count, squares)
            for k in range(count):
                weights[k] = problem.weights[k] / (1 + squares[k] / width**2) ** 2
            rows = np.flatnonzero(weights)
            if not step(problem.points_odom, problem.rays, rows, pose, moved, weights):
                return False
            pose[:] = moved
        if width == 1:
            return True
        width /= NARROWING
