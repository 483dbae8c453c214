"""Comparison of static and dynamic planning in the same worlds: benefit and cost of replanning.

Both rovers have the floor plan of the world as it was built, observe moving things by their
cameras, and steer alike. The static one plans its path once and stops before an obstacle; the
dynamic one repairs its path with D* Lite.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.trial_results import Metrics, Result
from trials.gym.studies.trial_runner import rover_nav
from trials.gym.world.free_space import NO_GEOM, FreeSpace
from trials.gym.world.ideal_depth import ray_disparity
from trials.navigation.grid_planner import GridPlanner
from trials.navigation.occupancy_grid import OccupancyGrid, empty_grid
from trials.navigation.settings import NavigatorSettings
from vo.contract.errors import SettingsError

Planning = Literal["static", "dynamic"]
PLANNINGS: tuple[Planning, ...] = ("static", "dynamic")
DEFAULTS = NavigatorSettings()
SETTINGS = DEFAULTS.model_copy(
    update={
        "initial_turn_deg": 0.0,
        "occupancy": DEFAULTS.occupancy.model_copy(update={"max_depth_m": 3.0}),
    }
)
"""With a floor plan only changes are new: no initial turn, and a short range."""
IDEAL_SETTINGS = SETTINGS.model_copy(update={"min_speckle_px": 0})
IDEAL_CHANNELS = ("pose", "goal")


@dataclass(frozen=True)
class PlanningResult(Result):
    """Result of a trial with one kind of planning.

    Attributes:
        planning: static or dynamic.
        spl: Success weighted by path length.
        plans: Number of times that the path was planned or repaired.
        expanded: Cells that D* Lite expanded.
        cpu_ms: Processor time of planning.
    """

    planning: Planning
    spl: float
    plans: int
    expanded: int
    cpu_ms: float


METRICS: Metrics[PlanningResult] = {
    "SPL": (lambda t: t.spl, 2),
    "time s": (lambda t: t.time_s, 1),
    "driven m": (lambda t: t.driven_m, 2),
    "plans": (lambda t: t.plans, 0),
    "expanded cells": (lambda t: t.expanded, 0),
    "planning, CPU ms": (lambda t: t.cpu_ms, 1),
    "CPU ms a plan": (lambda t: t.cpu_ms / max(1, t.plans), 2),
}


def parse_planning(text: str) -> list[Planning]:
    """Parse `static,dynamic`.

    Raises:
        SettingsError: If a kind is unknown, or there is none.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    unknown = [word for word in words if word not in PLANNINGS]
    if unknown or not words:
        said = ", ".join(unknown) or "none"
        raise SettingsError(f"unknown planning {said}; valid: {', '.join(PLANNINGS)}")
    return [cast(Planning, word) for word in words]


def run_world(
    options: Mapping[str, Any],
    plannings: Sequence[Planning],
    layout: int,
    runs: int,
    ideal: bool = False,
) -> list[PlanningResult]:
    """Run trials in one world with each kind of planning, from the same starts to the same goals.

    Args:
        options: Of RoverNav; `observe` must hold what the navigator needs.
        plannings: static, dynamic or both.
        layout: Seed of the world.
        runs: Number of pairs of start and goal.
        ideal: Depth by rays in place of cameras, so that nothing but planning can fail.

    Raises:
        DriftyardError: If an option is refused or the world has no traversable place.
    """
    warm_up = GridPlanner(np.ones((3, 3)), (0, 0), (2, 2))  # compiled before the clock runs
    warm_up.update(np.full((3, 3), 2.0))
    with rover_nav({**options, "observe": IDEAL_CHANNELS} if ideal else options) as env:
        return [
            _run(env, planning, layout, run, layout * runs + run, ideal)
            for run in range(runs)
            for planning in plannings
        ]


def floor_plan(space: FreeSpace, settings: NavigatorSettings) -> OccupancyGrid:
    """Draw the static obstacles of a world on the cells of a navigator."""
    height, width = space.obstacles.shape
    far = space.origin + space.cell_m * np.array([width - 1, height - 1])
    (x0_m, y0_m), (x1_m, y1_m) = space.origin.tolist(), far.tolist()
    grid = empty_grid((x0_m, x1_m), (y0_m, y1_m), settings.cell_m)
    cells = np.argwhere(space.obstacles != NO_GEOM)
    columns, rows = np.round(
        (space.points(cells) - np.array(grid.corner_xy_m)) / settings.cell_m
    ).astype(int).T  # fmt: skip
    grid.log_odds[rows, columns] = settings.occupancy.max_log_odds
    return grid


def _run(
    env: RoverNav, planning: Planning, layout: int, run: int, seed: int, ideal: bool
) -> PlanningResult:
    observation, info = env.reset(seed=seed, options={"layout": layout})
    settings = IDEAL_SETTINGS if ideal else SETTINGS
    plan = floor_plan(env.instance.traversable.space, settings)
    policy = NavigatorPolicy(env, settings, plan, replanning=planning == "dynamic")
    while not info["outcome"]:
        if ideal:
            disparity = ray_disparity(env.instance.simulation.world)
            observation["disparity"] = disparity[..., None]
        observation, _, _, _, info = env.step(policy.act(observation))
    effort = policy.navigator.effort
    return PlanningResult(
        layout=layout,
        run=run,
        localization=env.trial.localization,
        **{key: info[key] for key in ("outcome", "time_s", "driven_m", "way_m", "spl")},
        planning=planning,
        plans=effort.plans,
        expanded=effort.expanded,
        cpu_ms=1e3 * effort.cpu_s,
    )
