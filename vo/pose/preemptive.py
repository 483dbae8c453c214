"""Preemptive RANSAC: all hypotheses side by side, the worse half given up block by block.

Source: Nistér, Preemptive RANSAC for live structure and motion estimation, MVA 2005.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.pose.hypotheses import (
    MAX_POSES,
    SAMPLE,
    Problem,
    cost,
    cumulative_weights,
    draw_sample,
    propose,
)

HALVING_MATCHES = 10
"""Matches between two halvings of the hypotheses."""


@compiled()
def search_preemptive(
    problem: Problem, draws: Array, confidence: float, local_iterations: int, pose: Array
) -> int:
    """Score all hypotheses by a block of matches, keep the better half, continue with the next.

    The arguments and the result are those of `vo.pose.ransac.search_adaptive`; the number of
    samples is always that of the draws, and nothing is refitted.
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
        pose[:] = poses[alive[0]]
    return len(draws)
