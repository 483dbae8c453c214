"""Static against dynamic planning in the same worlds: what replanning gains, and what it costs.

Both rovers have the floor plan of the world as it was built, see by their cameras what moves,
and steer alike. The static one plans its way once, and stops before what blocks it; the dynamic
one repairs its way with D* Lite by what it sees.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import gymnasium
import numpy as np

from trials.execution.parallel import map_parallel
from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.env.rays import ray_disparity
from trials.gym.studies.fleet import NAV
from trials.gym.studies.trial_protocol import Measures
from trials.gym.world.free_space import NOTHING, FreeSpace
from trials.navigation.grid_planner import GridPlanner
from trials.navigation.occupancy_grid import OccupancyGrid, empty_grid
from trials.navigation.settings import NavigatorSettings
from vo.contract.errors import SettingsError

Planning = Literal["static", "dynamic"]
PLANNINGS: tuple[Planning, ...] = ("static", "dynamic")
DEFAULTS = NavigatorSettings()
SETTINGS = DEFAULTS.model_copy(
    update={
        "look_around_deg": 0.0,
        "occupancy": DEFAULTS.occupancy.model_copy(update={"farthest_m": 3.0}),
    }
)
"""Who has a floor plan need not look around first, nor far: only what has changed is news."""

IDEAL = SETTINGS.model_copy(update={"speckle_px": 0})
BLIND = ("pose", "goal")


@dataclass(frozen=True)
class PlannedTrial:
    """What came of one trial.

    Attributes:
        layout: Seed of the world.
        run: Number of start and goal in it.
        planning: static or dynamic.
        localization: Source.
        outcome: success, collision, tipped, stuck, lost or timeout.
        time_s: That it took.
        driven_m: True path.
        way_m: Shortest way in the world as it was built.
        spl: Success weighted by path length.
        plans: How often the way was planned or repaired.
        expanded: Cells that D* Lite expanded.
        cpu_ms: Processor time of planning.
    """

    layout: int
    run: int
    planning: Planning
    localization: str
    outcome: str
    time_s: float
    driven_m: float
    way_m: float
    spl: float
    plans: int
    expanded: int
    cpu_ms: float


MEASURES: Measures[PlannedTrial] = {
    "SPL": (lambda t: t.spl, 2),
    "time s": (lambda t: t.time_s, 1),
    "driven m": (lambda t: t.driven_m, 2),
    "plans": (lambda t: t.plans, 0),
    "expanded cells": (lambda t: t.expanded, 0),
    "planning, CPU ms": (lambda t: t.cpu_ms, 1),
    "CPU ms a plan": (lambda t: t.cpu_ms / max(1, t.plans), 2),
}


def parse_planning(text: str) -> list[Planning]:
    """Read `static,dynamic`.

    Raises:
        SettingsError: If one is unknown, or there is none.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    unknown = [word for word in words if word not in PLANNINGS]
    if unknown or not words:
        said = ", ".join(unknown) or "none"
        raise SettingsError(f"unknown planning {said}; valid: {', '.join(PLANNINGS)}")
    return [cast(Planning, word) for word in words]


def run_planned(
    options: Mapping[str, Any],
    plannings: Sequence[Planning],
    layouts: Sequence[int],
    runs: int,
    ideal: bool = False,
) -> Iterator[list[PlannedTrial]]:
    """Drive in every world with every way of planning, from the same starts to the same goals.

    Args:
        options: Of RoverNav; `observe` must hold what the navigator needs.
        plannings: static, dynamic or both.
        layouts: Seeds of the worlds.
        runs: Pairs of start and goal in each.
        ideal: Depth by rays in place of cameras, so that nothing but planning can fail.

    Yields:
        The trials of a world, as worlds are done with.

    Raises:
        DriftyardError: If an option is refused or a world has no free place.
    """
    asked = [(dict(options), tuple(plannings), layout, runs, ideal) for layout in layouts]
    for _, of_world in map_parallel(drive_world, asked):
        yield of_world


def drive_world(
    options: Mapping[str, Any],
    plannings: Sequence[Planning],
    layout: int,
    runs: int,
    ideal: bool = False,
) -> list[PlannedTrial]:
    """Drive every run of one world with every way of planning; see `run_planned`."""
    warm = GridPlanner(np.ones((3, 3)), (0, 0), (2, 2))  # compiled before the clock runs
    warm.update(np.full((3, 3), 2.0))
    asked = {**options, "observe": BLIND} if ideal else options
    env = gymnasium.make(NAV, disable_env_checker=True, **asked).unwrapped
    assert isinstance(env, RoverNav)
    try:
        return [
            _drive(env, planning, layout, run, layout * runs + run, ideal)
            for run in range(runs)
            for planning in plannings
        ]
    finally:
        env.close()


def floor_plan(free: FreeSpace, settings: NavigatorSettings) -> OccupancyGrid:
    """What stands in a world for good, on the cells of a navigator."""
    height, width = free.obstacles.shape
    far = free.origin + free.cell_m * np.array([width - 1, height - 1])
    (x0_m, y0_m), (x1_m, y1_m) = free.origin.tolist(), far.tolist()
    grid = empty_grid((x0_m, x1_m), (y0_m, y1_m), settings.cell_m)
    cells = np.argwhere(free.obstacles != NOTHING)
    columns, rows = np.round(
        (free.points(cells) - np.array(grid.corner_xy_m)) / settings.cell_m
    ).astype(int).T  # fmt: skip
    grid.log_odds[rows, columns] = settings.occupancy.most
    return grid


def _drive(
    env: RoverNav, planning: Planning, layout: int, run: int, seed: int, ideal: bool
) -> PlannedTrial:
    observation, info = env.reset(seed=seed, options={"layout": layout})
    settings = IDEAL if ideal else SETTINGS
    plan = floor_plan(env.site.passages.free, settings)
    policy = NavigatorPolicy(env, settings, plan, replanning=planning == "dynamic")
    while not info["outcome"]:
        if ideal:
            observation["disparity"] = ray_disparity(env.site.simulation.world)[..., None]
        observation, _, _, _, info = env.step(policy.act(observation))
    effort = policy.navigator.effort
    return PlannedTrial(
        layout,
        run,
        planning,
        env.trial.localization,
        info["outcome"],
        info["time_s"],
        info["driven_m"],
        info["way_m"],
        info["spl"],
        effort.plans,
        effort.expanded,
        1e3 * effort.cpu_s,
    )
