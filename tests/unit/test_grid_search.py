"""Shortest paths on the grid against SciPy's Dijkstra, on the graph of all steps."""

from itertools import product

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from trials.gym.world.grid_search import grid_distances, grid_path

CELL_M = 0.07


def scipy_distances(mask, start):
    height, width = mask.shape
    lengths = sparse.lil_matrix((mask.size, mask.size))
    for r, c, down, right in product(range(height), range(width), (-1, 0, 1), (-1, 0, 1)):
        to = r + down, c + right
        if (down, right) == (0, 0) or not (0 <= to[0] < height and 0 <= to[1] < width):
            continue
        if mask[r, c] and mask[to] and mask[r, to[1]] and mask[to[0], c]:
            length = CELL_M if 0 in (down, right) else float(np.sqrt(2)) * CELL_M
            lengths[r * width + c, to[0] * width + to[1]] = length
    found = dijkstra(lengths.tocsr(), indices=start[0] * width + start[1])
    return np.asarray(found).reshape(mask.shape)


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_scipy_to_the_bit(seed):
    mask = np.random.default_rng(seed).random((15, 19)) < 0.7
    row, column = np.argwhere(mask)[seed].tolist()
    wanted = scipy_distances(mask, (row, column))
    np.testing.assert_array_equal(grid_distances(mask, row, column, CELL_M, np.inf), wanted)
    limited = np.where(wanted <= 0.5, wanted, np.inf)
    np.testing.assert_array_equal(grid_distances(mask, row, column, CELL_M, 0.5), limited)


def test_path_has_the_length_of_its_distance_and_cuts_no_corner():
    mask = np.random.default_rng(3).random((20, 20)) < 0.75
    goal = np.argwhere(mask)[0].tolist()
    distances = grid_distances(mask, *goal, CELL_M, np.inf)
    start = np.argwhere(np.isfinite(distances))[-1].tolist()
    path = grid_path(mask, distances, *start, CELL_M)
    assert path[0].tolist() == start
    assert path[-1].tolist() == goal
    steps = np.diff(path, axis=0)
    assert abs(steps).max() == 1
    assert np.linalg.norm(steps, axis=1).sum() * CELL_M == pytest.approx(distances[tuple(start)])
    for (r, c), (down, right) in zip(path[:-1], steps, strict=True):
        assert mask[r + down, c]
        assert mask[r, c + right]


def test_path_from_a_cell_without_one_is_the_cell_itself():
    mask = np.array([[True, False, True]])
    distances = grid_distances(mask, 0, 0, CELL_M, np.inf)
    assert grid_path(mask, distances, 0, 2, CELL_M).tolist() == [[0, 2]]
