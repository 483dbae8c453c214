"""Time of D* Lite and of A* for replanning on a grid; `driftyard replanning`.

Both are compiled and share steps, costs and heap. In a warehouse of shelves and aisles on 500 x 500
cells, the agent moves a few cells towards its goal, cells become occupied and both planners plan;
the agent moves on, the cells become free and both plan again. CPU time is measured, without copying
and padding of the grid.
"""

from collections.abc import Callable
from math import inf
from time import process_time

import numpy as np

from trials.navigation.astar import astar
from trials.navigation.grid import Cell, cell_index, make_grid
from trials.navigation.planner import GridPlanner
from vo.contract.arrays import Array

SHELF, AISLE, CROSSING = 8, 12, 50
"""Depth of a shelf, width of an aisle and distance of the crossings, cells."""
STRIDE = 3
"""Number of cells between two changes."""


Change = Callable[[np.random.Generator, Array, list[Cell]], list[Cell]]
"""Takes a generator, costs and the path ahead; returns the cells that become occupied."""


def warehouse(side: int, rng: np.random.Generator) -> Array:
    """Return (side, side) costs: shelves, aisles, crossings, and boxes at random cells."""
    costs = np.ones((side, side))
    row, column = np.indices(costs.shape)
    shelf = (row % (SHELF + AISLE) >= AISLE) & (column % CROSSING >= AISLE)
    costs[shelf | (rng.random(costs.shape) < 0.005)] = inf
    return costs


def measure(
    change: Change,
    side: int,
    changes: int,
    rng: np.random.Generator,
    done: Callable[[object], None],
) -> Array:
    """Move from corner to corner repeatedly, and time both planners after each change.

    Returns:
        (changes, 3) CPU time of D* Lite and of A*, ms, and number of cells that D* Lite expanded.
    """
    timings: list[tuple[float, float, int]] = []
    astar(make_grid(np.ones((3, 3))), 49, 16, 32)  # compiled before the clock runs
    while len(timings) < changes:
        costs = warehouse(side, rng)
        first, last = rng.integers(AISLE, size=2).tolist()
        ends = (0, first), (side - 1 - SHELF, side - 1 - last)
        costs[ends[0]] = costs[ends[1]] = 1.0
        planner, start = GridPlanner(costs, *ends), ends[0]
        closed: list[Cell] = []
        while len(path := planner.path()) > 2 * STRIDE or closed:
            start = path[STRIDE] if len(path) > STRIDE else start
            planner.move(start)
            reopen = closed
            near = () if reopen else change(rng, costs, path[STRIDE:])
            closed = [c for c in near if c not in (start, ends[1]) and costs[c] < inf]
            if not closed + reopen:
                continue
            for cell in closed + reopen:
                costs[cell] = inf if closed else 1.0
            timings.append(_time(planner, costs, closed + reopen, start, ends[1]))
            done(None)
            if len(timings) == changes:
                break
    return np.array(timings)


def _time(
    planner: GridPlanner, costs: Array, cells: list[Cell], start: Cell, goal: Cell
) -> tuple[float, float, int]:
    values = [float(costs[cell]) for cell in cells]
    grid = make_grid(costs)
    ends = cell_index(grid, start), cell_index(grid, goal)
    before = planner.search.expanded
    times = [process_time()]
    planner.replan(cells, values)
    times.append(process_time())
    _, cost = astar(grid, len(grid.cells), *ends)
    times.append(process_time())
    assert cost == planner.search.cost or abs(cost - planner.search.cost) < 1e-6 * cost
    replan_s, plan_s = np.diff(times)
    return 1e3 * replan_s, 1e3 * plan_s, planner.search.expanded - before


def near_agent(rng: np.random.Generator, costs: Array, path: list[Cell]) -> list[Cell]:
    """Return four cells within five cells of the agent."""
    return _inside(np.array(path[0]) + rng.integers(-5, 6, size=(4, 2)), costs)


def on_the_way(rng: np.random.Generator, costs: Array, path: list[Cell]) -> list[Cell]:
    """Return three by three cells on the path, up to thirty cells ahead."""
    ahead = path[min(len(path) - 2, int(rng.integers(3, 30)))]
    return _inside(np.array(ahead) + np.indices((3, 3)).reshape(2, -1).T - 1, costs)


def aisle(rng: np.random.Generator, costs: Array, path: list[Cell]) -> list[Cell]:
    """Return the cells across an aisle, up to thirty cells ahead on the path."""
    row, column = path[min(len(path) - 2, int(rng.integers(5, 30)))]
    in_aisle = row % (SHELF + AISLE) < AISLE
    first = row - row % (SHELF + AISLE) if in_aisle else column - column % CROSSING
    across = np.arange(first, first + AISLE)
    along = np.full(AISLE, column if in_aisle else row)
    return _inside(np.stack([across, along] if in_aisle else [along, across], axis=1), costs)


def _inside(cells: Array, costs: Array) -> list[Cell]:
    inside = ((cells >= 0) & (cells < costs.shape)).all(axis=1)
    return sorted({(int(row), int(column)) for row, column in cells[inside]})


CHANGES: dict[str, Change] = {
    "cells near the agent": near_agent,
    "cells on the way": on_the_way,
    "the aisle ahead": aisle,
}
