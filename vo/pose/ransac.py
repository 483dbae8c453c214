"""Random sample consensus with local optimisation (thesis 2.2, 2.7).

Source: Fischler and Bolles, CACM 1981, with L = log p_fail / log(1 - p_good^k), thesis eq. 2.28;
Chum, Matas and Kittler, Locally optimized RANSAC, DAGM 2003; Nistér, Preemptive RANSAC for live
structure and motion estimation, MVA 2005.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask, copy_values
from vo.contract.compilation import compiled
from vo.pose.gauss_newton import determines_pose
from vo.pose.hypotheses import (
    MAX_POSES,
    SAMPLE,
    Problem,
    cost,
    cumulative_weights,
    draw_sample,
    inlier_rows,
    propose,
    refit,
)

FINAL_ITERATIONS = 20
"""Largest number of refits of the best pose, if poses are refitted at all."""

HALVING_MATCHES = 10
"""Matches between two halvings of the hypotheses."""


@dataclass(frozen=True)
class Consensus:
    """The pose (4, 4) that most matches agree with, and the mask (N,) of these inliers."""

    T_odom_cam: Array
    inliers: Mask


def ransac(
    problem: Problem, T_odom_guess: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    """Find the pose of least cost; the expected one is not used.

    None if there are fewer than three matches or no sample gives a pose.
    """
    count = len(problem.points_odom)
    if count < SAMPLE:
        return None
    # In random order, so that the first matches scored stand for all.
    order = rng.permutation(count)
    shuffled = problem._replace(
        points_odom=problem.points_odom[order],
        rays=problem.rays[order],
        points_cam=problem.points_cam[order],
        weights=problem.weights[order],
    )
    draws = rng.random((settings.max_hypotheses, SAMPLE))
    pose = np.zeros((3, 4))
    SCHEMES[settings.scheme](shuffled, draws, settings.confidence, settings.local_iterations, pose)
    found = consensus(shuffled, pose, settings)
    if found is None:
        return None
    mask = np.zeros(count, dtype=np.bool_)
    mask[order] = found.inliers
    return replace(found, inliers=mask)


def consensus(problem: Problem, pose: Array, settings: MotionSettings) -> Consensus | None:
    """Refit a pose (3, 4) to its inliers; None if there are fewer than three."""
    pose = pose.copy()
    rows = _refit_finally(problem, pose, FINAL_ITERATIONS if settings.local_iterations else 0)
    if len(rows) < SAMPLE:
        return None
    mask = np.zeros(len(problem.points_odom), dtype=np.bool_)
    mask[rows] = True
    return Consensus(se3.inverse(se3.pose(pose[:, :3], pose[:, 3])), mask)


def determined_consensus(
    problem: Problem, pose: Array, settings: MotionSettings
) -> Consensus | None:
    """Refit a pose (3, 4) to its inliers; None if these alone, without a guess, do not give it."""
    found = consensus(problem, pose, settings)
    if found is None:
        return None
    rows = np.flatnonzero(found.inliers)
    pose = np.ascontiguousarray(se3.inverse(found.T_odom_cam)[:3])
    determined = determines_pose(problem.points_odom, problem.rays, rows, pose)
    return found if len(rows) > SAMPLE and determined else None


@compiled()
def samples_needed(p_good: float, confidence: float) -> float:
    """Samples of three after which one is all good with the given confidence (eq. 2.28)."""
    p_sample = p_good**SAMPLE
    if p_sample >= 1:
        return 1.0
    if p_sample <= 0:
        return np.inf
    return np.ceil(np.log(1 - confidence) / np.log1p(-p_sample))


@compiled()
def search_adaptive(
    problem: Problem, draws: Array, confidence: float, local_iterations: int, pose: Array
) -> int:
    """Score one sample after the other until a better one has become unlikely.

    Write the pose (3, 4) of least cost; return the number of samples. The matches are in random
    order; draws (S, 3) are uniform random numbers, three a sample; with the confidence one sample
    shall be all good. Each new best pose is refitted.
    """
    count = len(problem.points_odom)
    bounds = cumulative_weights(problem.weights)
    sample, poses = np.empty(SAMPLE, dtype=np.int64), np.empty((MAX_POSES, 3, 4))
    best = np.inf
    samples, needed = 0, len(draws)
    while samples < needed:
        draw_sample(draws[samples], bounds, sample)
        samples += 1
        better = False
        for k in range(propose(problem, sample, poses)):
            now = cost(problem, poses[k], 0, count, best)
            if now < best:
                best, better = now, True
                copy_values(poses[k], pose)
        if better:
            best = refit(problem, pose, best, local_iterations)
            share = problem.weights[inlier_rows(problem, pose)].sum() / bounds[-1]
            needed = int(min(len(draws), samples_needed(share, confidence)))
    return samples


@compiled()
def search_preemptive(
    problem: Problem, draws: Array, confidence: float, local_iterations: int, pose: Array
) -> int:
    """Score all hypotheses by a block of matches, keep the better half, continue with the next.

    The arguments and the result are those of `search_adaptive`; the number of samples is always
    that of the draws, and nothing is refitted.
    """
    count = len(problem.points_odom)
    sample, poses = np.empty(SAMPLE, dtype=np.int64), np.empty((MAX_POSES * len(draws), 3, 4))
    bounds = cumulative_weights(problem.weights)
    found = 0
    for draw in draws:
        draw_sample(draw, bounds, sample)
        found += propose(problem, sample, poses[found:])
    costs, alive = np.zeros(found), np.arange(found)
    first = 0
    while first < count and len(alive) > 1:
        last = min(first + HALVING_MATCHES, count)
        for k in alive:
            costs[k] += cost(problem, poses[k], first, last, np.inf)
        alive = alive[np.argsort(costs[alive])[: max(len(alive) // 2, 1)]]
        first = last
    if found:
        copy_values(poses[alive[0]], pose)
    return len(draws)


@compiled()
def _refit_finally(problem: Problem, pose: Array, iterations: int) -> Indices:
    """Refit the best pose, in place, until it stays; return the rows of its inliers."""
    refit(problem, pose, cost(problem, pose, 0, len(problem.points_odom), np.inf), iterations)
    return inlier_rows(problem, pose)


Search = Callable[[Problem, Array, float, int, Array], int]
SCHEMES: dict[str, Search] = {"adaptive": search_adaptive, "preemptive": search_preemptive}
"""Searches for the pose of least cost, by `motion.scheme`."""
