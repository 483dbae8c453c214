"""Random sample consensus: adaptive or preemptive, with local optimisation (thesis 2.2, 2.7).

Source: Fischler and Bolles, CACM 1981, with L = log p_fail / log(1 - p_good^k), thesis eq. 2.28;
Chum, Matas and Kittler, Locally optimized RANSAC, DAGM 2003; Nistér, Preemptive RANSAC for live
structure and motion estimation, MVA 2005.
"""

from dataclasses import dataclass, replace

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.compilation import compiled
from vo.pose.hypotheses import (
    MOST_POSES,
    SAMPLE,
    Problem,
    cost,
    improve,
    inliers,
    propose,
    uncertainty,
)

FINISHING = 20
"""Most refits of the best pose, if poses are refitted at all."""


PREEMPTIVE_BLOCK = 10
"""Matches between two halvings of the hypotheses."""


@dataclass(frozen=True)
class Consensus:
    """The pose that most matches agree with.

    Attributes:
        T: (4, 4) T_odom_cam.
        inliers: (N,) matches within the threshold of it.
        trials: Samples drawn.
        covariance: (6, 6) of the pose that fits the inliers best, tangent order (w, v) in the
            camera's frame as GTSAM's Pose3; NaN where the inliers do not determine it.
    """

    T: Array
    inliers: Mask
    trials: int
    covariance: Array


def ransac(
    problem: Problem, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    """Find the pose of least cost.

    Args:
        problem: N matches, all finite.
        settings: Scheme, confidence, trials and refits.
        rng: Draws the samples.

    Returns:
        None if there are fewer than three matches or no sample gives a pose.
    """
    count = len(problem.points_odom)
    if count < SAMPLE:
        return None
    # In random order, so that the first matches judged stand for all.
    order = rng.permutation(count)
    shuffled = problem._replace(
        points_odom=problem.points_odom[order],
        rays=problem.rays[order],
        points_cam=problem.points_cam[order],
        weights=problem.weights[order],
    )
    draws = rng.random((settings.max_hypotheses, SAMPLE))
    pose = np.zeros((3, 4))
    if settings.scheme == "preemptive":
        trials = _search_preemptive(shuffled, draws, PREEMPTIVE_BLOCK, pose)
    else:
        trials = _search(shuffled, draws, settings.confidence, settings.local_iterations, pose)
    found = consensus(shuffled, pose, int(trials), settings)
    if found is None:
        return None
    mask = np.zeros(count, dtype=np.bool_)
    mask[order] = found.inliers
    return replace(found, inliers=mask)


def consensus(
    problem: Problem, pose: Array, trials: int, settings: MotionSettings
) -> Consensus | None:
    """Refit a pose (3, 4) to who agrees with it; None if fewer than three matches do."""
    pose = pose.copy()
    rows, covariance = _finish(problem, pose, FINISHING if settings.local_iterations else 0)
    if len(rows) < SAMPLE:
        return None
    mask = np.zeros(len(problem.points_odom), dtype=np.bool_)
    mask[rows] = True
    T_odom_cam = se3.inverse(se3.pose(pose[:, :3], pose[:, 3]))
    return Consensus(T_odom_cam, mask, trials, covariance)


@compiled()
def trials_needed(p_good: float, confidence: float) -> float:
    """Samples of three after which one is all good with the given confidence (eq. 2.28)."""
    p_sample = p_good**SAMPLE
    if p_sample >= 1:
        return 1.0
    if p_sample <= 0:
        return np.inf
    return np.ceil(np.log(1 - confidence) / np.log1p(-p_sample))


@compiled()
def _search(
    problem: Problem, draws: Array, confidence: float, local_iterations: int, pose: Array
) -> int:
    """One sample after the other until a better one has become unlikely; returns how many."""
    count = len(problem.points_odom)
    marks = _marks(problem.weights)
    sample, poses = np.empty(SAMPLE, dtype=np.int64), np.empty((MOST_POSES, 3, 4))
    best = np.inf
    trials, needed = 0, len(draws)
    while trials < needed:
        _choose(draws[trials], marks, sample)
        trials += 1
        better = False
        for k in range(propose(problem, sample, poses)):
            now = cost(problem, poses[k], 0, count, best)
            if now < best:
                best, better, pose[:] = now, True, poses[k]
        if better:
            best = improve(problem, pose, best, local_iterations)
            share = problem.weights[inliers(problem, pose)].sum() / marks[-1]
            needed = int(min(len(draws), trials_needed(share, confidence)))
    return trials


@compiled()
def _search_preemptive(problem: Problem, draws: Array, block: int, pose: Array) -> int:
    """Judge all hypotheses by a block of matches, keep the better half, go on with the next.

    Returns:
        The number of samples.
    """
    count = len(problem.points_odom)
    sample, poses = np.empty(SAMPLE, dtype=np.int64), np.empty((MOST_POSES * len(draws), 3, 4))
    marks = _marks(problem.weights)
    found = 0
    for draw in draws:
        _choose(draw, marks, sample)
        found += propose(problem, sample, poses[found:])
    costs, alive = np.zeros(found), np.arange(found)
    seen = 0
    while seen < count and len(alive) > 1:
        after = min(seen + block, count)
        for k in alive:
            costs[k] += cost(problem, poses[k], seen, after, np.inf)
        alive = alive[np.argsort(costs[alive])[: max(len(alive) // 2, 1)]]
        seen = after
    if found:
        pose[:] = poses[alive[0]]
    return len(draws)


@compiled()
def _marks(weights: Array) -> Array:
    """(N + 1,) where each match's stretch of the total weight begins, and the total."""
    marks = np.zeros(len(weights) + 1)
    marks[1:] = np.cumsum(weights)
    return marks


@compiled()
def _choose(draw: Array, marks: Array, sample: Indices) -> None:
    """Turn three numbers below 1 into three different rows, each drawn in proportion to weight."""
    for k in range(SAMPLE):
        left = marks[-1]
        taken = np.sort(sample[:k])
        for row in taken:
            left -= marks[row + 1] - marks[row]
        place = draw[k] * left
        for row in taken:  # step over the rows that are taken
            if place >= marks[row]:
                place += marks[row + 1] - marks[row]
        row = np.searchsorted(marks, place, side="right") - 1
        sample[k] = min(row, len(marks) - 2)


@compiled()
def _finish(problem: Problem, pose: Array, rounds: int) -> tuple[Indices, Array]:
    """Refit the best pose, in place, until it stays; its inliers and its covariance."""
    improve(problem, pose, cost(problem, pose, 0, len(problem.points_odom), np.inf), rounds)
    rows = inliers(problem, pose)
    return rows, uncertainty(problem, pose, rows)
