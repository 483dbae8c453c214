"""D* Lite against Dijkstra (scipy) and A* after each of many random changes, while moving."""

from itertools import pairwise
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from trials.navigation import PlanningError
from trials.navigation.adjacency import adjacency
from trials.navigation.astar import astar
from trials.navigation.dstar_lite import DStarLite
from trials.navigation.grid import cell_index, grid_cells, make_grid
from trials.navigation.planner import GridPlanner

CHANGES = 1000


class Roads:
    """Points in the plane; every edge costs at least its length."""

    def __init__(self, rng, nodes, degree, informed=True):
        self.xy = rng.uniform(size=(nodes, 2))
        self.costs = {}
        for a in range(nodes):
            for b in rng.choice(nodes, degree, replace=False).tolist():
                if a != b:
                    self.costs[a, b] = self.length(a, b) * rng.uniform(1, 3)
        self.edges = list(self.costs)
        self.bounds = np.zeros((nodes, nodes))
        if informed:
            self.bounds = np.linalg.norm(self.xy[:, None] - self.xy, axis=2)

    def length(self, a, b):
        return float(np.hypot(*(self.xy[a] - self.xy[b])))

    def graph(self):
        return adjacency(self.edges, np.array(list(self.costs.values())), self.bounds)

    def dijkstra(self, start, goal):
        open_edges = {e: c for e, c in self.costs.items() if c < inf}
        rows, columns = zip(*open_edges, strict=True) if open_edges else ((), ())
        n = len(self.xy)
        matrix = csr_matrix((list(open_edges.values()), (rows, columns)), shape=(n, n))
        return dijkstra(matrix, indices=start)[goal]


def grid_astar(costs, start, goal):
    grid = make_grid(costs)
    ends = cell_index(grid, start), cell_index(grid, goal)
    parents, cost = astar(grid, len(grid.cells), *ends)
    nodes = [ends[1]] if cost < inf else []
    while nodes and nodes[-1] != ends[0]:
        nodes.append(int(parents[nodes[-1]]))
    return grid_cells(grid, nodes[::-1]), cost


def grid_dijkstra(costs, start, goal):
    """All steps by shifting arrays; diagonals only where both cells beside them are open."""
    height, width = costs.shape
    ids = np.arange(height * width).reshape(height, width)
    rows, columns, values = [], [], []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            if (down, right) == (0, 0):
                continue
            here = np.s_[
                max(0, -down) : height - max(0, down), max(0, -right) : width - max(0, right)
            ]
            there = np.s_[
                max(0, down) : height + min(0, down), max(0, right) : width + min(0, right)
            ]
            step = np.hypot(down, right) * (costs[here] + costs[there]) / 2
            if down and right:
                beside = costs[here[0], there[1]] + costs[there[0], here[1]]
                step = np.where(np.isfinite(beside), step, inf)
            fine = np.isfinite(step)
            rows.append(ids[here][fine])
            columns.append(ids[there][fine])
            values.append(step[fine])
    edges = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = csr_matrix(edges, shape=(ids.size, ids.size))
    return dijkstra(matrix, indices=ids[start])[ids[goal]]


def assert_walks(costs, path, start, goal, cost):
    if cost == inf:
        assert path == []
        return
    assert (path[0], path[-1]) == (start, goal)
    walked = sum(costs[a, b] for a, b in pairwise(path))
    assert walked == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("informed", [True, False])
@pytest.mark.parametrize(("nodes", "degree"), [(40, 3), (150, 5), (30, 2)])
def test_graph_after_a_thousand_changes_stays_optimal(nodes, degree, informed):
    rng = np.random.default_rng([nodes, degree])
    roads = Roads(rng, nodes, degree, informed)
    start, goal = 0, nodes - 1
    graph = roads.graph()
    planner = DStarLite(graph, nodes, start, goal)
    closed = 0
    for _ in range(CHANGES):
        path = planner.path()
        edge = int(rng.integers(len(roads.edges)))
        a, b = roads.edges[edge]
        factor = inf if rng.random() < 0.5 else rng.uniform(1, 4)
        graph.costs[edge] = roads.costs[a, b] = roads.length(a, b) * factor
        if len(path) > 1 and rng.random() < 0.1:  # drive a step, or appear elsewhere
            start = path[1] if rng.random() < 0.8 else int(rng.integers(nodes))
            planner.move(start)
        planner.replan(np.array([a]))
        assert planner.cost == pytest.approx(roads.dijkstra(start, goal), rel=1e-9)
        assert planner.cost == pytest.approx(astar(graph, nodes, start, goal)[1], rel=1e-9)
        assert_walks(roads.costs, planner.path(), start, goal, planner.cost)
        closed += planner.cost == inf
    assert (0 < closed < CHANGES) == (degree == 2)


@pytest.mark.parametrize("density", [0.1, 0.25, 0.35])
def test_grid_after_a_thousand_changes_stays_optimal(density):
    rng = np.random.default_rng(int(100 * density))
    costs = np.where(rng.random((18, 23)) < density, inf, rng.choice([1.0, 1.0, 2.5], (18, 23)))
    start, goal = (2, 3), (15, 20)
    planner = GridPlanner(costs, start, goal)
    outcomes = set()
    for _ in range(CHANGES):
        count = int(rng.integers(1, 6))
        rows, columns = rng.integers(18, size=count), rng.integers(23, size=count)
        if rng.random() < 0.3:  # a wall across, or a gate in it
            rows, columns = np.arange(18), np.full(18, rng.integers(23))
        shut = rng.random(len(rows)) < density
        costs[rows, columns] = np.where(shut, inf, rng.choice([1.0, 1.7, 4.0], len(rows)))
        path = planner.path()
        if len(path) > 1 and rng.random() < 0.3:
            start = path[1]
            planner.move(start)
        cells = sorted({*zip(rows.tolist(), columns.tolist(), strict=True)})
        planner.replan(cells, [costs[cell] for cell in cells])
        expected = grid_dijkstra(costs, start, goal)
        assert planner.search.cost == pytest.approx(expected, rel=1e-9)
        assert grid_astar(costs, start, goal)[1] == pytest.approx(expected, rel=1e-9)
        path = planner.path()
        if planner.search.cost < inf:
            assert (path[0], path[-1]) == (start, goal)
            assert sum(
                np.hypot(a[0] - b[0], a[1] - b[1]) * (costs[a] + costs[b]) / 2
                for a, b in pairwise(path)
            ) == pytest.approx(expected)
        else:
            assert path == []
        outcomes.add(planner.search.cost < inf)
        if start == goal:
            start = (int(rng.integers(18)), int(rng.integers(23)))
            planner.move(start)
            planner.replan()
    assert outcomes == {True, False} or density < 0.2


def test_grid_with_tied_keys_searches_to_the_end():
    # Without obstacles all keys on the way tie, up to rounding; what the wall raises must be seen.
    rng = np.random.default_rng(3)
    costs = np.ones((40, 60))
    start, goal = (33, 2), (5, 57)
    planner = GridPlanner(costs, start, goal)
    for _ in range(150):
        if start == goal:
            break
        path = planner.path()
        start = path[1]
        planner.move(start)
        ahead = path[min(len(path) - 1, int(rng.integers(2, 12)))]
        if ahead != goal:
            costs[ahead] = inf
        planner.update(costs)
        assert planner.search.cost == pytest.approx(grid_dijkstra(costs, start, goal), rel=1e-9)
    assert start == goal


@given(st.integers(0, 10_000), st.integers(2, 12), st.integers(2, 12))
def test_grid_planners_agree_with_dijkstra(seed, height, width):
    rng = np.random.default_rng(seed)
    costs = np.where(rng.random((height, width)) < 0.3, inf, rng.uniform(1, 5, (height, width)))
    start, goal = (
        (int(rng.integers(height)), int(rng.integers(width))),
        (int(rng.integers(height)), int(rng.integers(width))),
    )
    expected = 0.0 if start == goal else grid_dijkstra(costs, start, goal)
    assert GridPlanner(costs, start, goal).search.cost == pytest.approx(expected)
    assert grid_astar(costs, start, goal)[1] == pytest.approx(expected)


def test_planners_start_is_goal_cost_nothing():
    graph = Roads(np.random.default_rng(0), 10, 2).graph()
    planner = DStarLite(graph, 10, 4, 4)
    assert (planner.cost, planner.path()) == (0.0, [4])
    assert astar(graph, 10, 4, 4)[1] == 0.0
    grid = GridPlanner(np.ones((3, 3)), (1, 1), (1, 1))
    assert (grid.search.cost, grid.path()) == (0.0, [(1, 1)])
    assert grid_astar(np.ones((3, 3)), (1, 1), (1, 1)) == ([(1, 1)], 0.0)


def test_grid_planners_do_not_cut_corners():
    costs = np.array([[1, inf], [1, 1]])
    assert grid_astar(costs, (0, 0), (1, 1))[0] == [(0, 0), (1, 0), (1, 1)]
    planner = GridPlanner(costs, (0, 0), (1, 1))
    assert (planner.search.cost, planner.path()) == (2.0, [(0, 0), (1, 0), (1, 1)])
    planner.replan([(0, 1)], [1.0])
    assert planner.path() == [(0, 0), (1, 1)]
    assert planner.search.cost == pytest.approx(2**0.5)


@pytest.mark.parametrize("wrong", [nan, 0.0, -1.0])
def test_planners_refuse_a_cost_that_is_not_positive(wrong):
    roads = Roads(np.random.default_rng(0), 10, 3)
    a, b = roads.edges[5]
    roads.costs[a, b] = wrong
    with pytest.raises(PlanningError, match=f"edge {a} to {b}: cost {wrong} is not positive"):
        roads.graph()
    with pytest.raises(PlanningError, match=r"cell \(1, 2\)"):
        GridPlanner(np.array([[1, 1, 1], [1, 1, wrong]]), (0, 0), (1, 1))
    planner = GridPlanner(np.ones((3, 3)), (0, 0), (2, 2))
    with pytest.raises(PlanningError, match="1 or more"):
        planner.replan([(1, 1), (0, 1)], [2.0, wrong])
    with pytest.raises(PlanningError, match="1 or more"):
        planner.update(np.full((3, 3), wrong))
    assert planner.search.cost == pytest.approx(8**0.5)


def test_grid_planners_refuse_cells_outside_the_grid():
    for start, goal in (((-1, 0), (2, 2)), ((0, 0), (2, 3)), ((3, 0), (0, 0))):
        with pytest.raises(PlanningError, match="outside the grid of 3 x 3"):
            GridPlanner(np.ones((3, 3)), start, goal)
        with pytest.raises(PlanningError, match="outside the grid of 3 x 3"):
            grid_astar(np.ones((3, 3)), start, goal)
    planner = GridPlanner(np.ones((3, 3)), (0, 0), (2, 2))
    with pytest.raises(PlanningError, match="outside"):
        planner.move((0, 3))
    with pytest.raises(PlanningError, match="outside"):
        planner.replan([(0, 9)], [1.0])
    with pytest.raises(PlanningError, match="2 cells with 1 costs"):
        planner.replan([(0, 0), (0, 1)], [1.0])
    with pytest.raises(PlanningError, match="shape"):
        planner.update(np.ones((3, 4)))
