"""Random samples of matches, each match drawn in proportion to its weight."""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled

SAMPLE = 3
"""Matches of a minimal sample."""


@compiled()
def cumulative_weights(weights: Array) -> Array:
    """Sum the weights before each of N matches, and all of them: (N + 1,)."""
    bounds = np.zeros(len(weights) + 1)
    bounds[1:] = np.cumsum(weights)
    return bounds


@compiled()
def draw_sample(numbers: Array, bounds: Array, sample: Indices) -> None:
    """Write three different rows, each drawn in proportion to its weight.

    Args:
        numbers: (3,) uniform random numbers in [0, 1).
        bounds: (N + 1,) from `cumulative_weights`.
        sample: (3,) receives the rows.
    """
    for k in range(SAMPLE):
        left = bounds[-1]
        taken = np.sort(sample[:k])
        for row in taken:
            left -= bounds[row + 1] - bounds[row]
        place = numbers[k] * left
        for row in taken:  # step over the rows that are taken
            if place >= bounds[row]:
                place += bounds[row + 1] - bounds[row]
        row = np.searchsorted(bounds, place, side="right") - 1
        sample[k] = min(row, len(bounds) - 2)
