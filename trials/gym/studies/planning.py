"""Comparison of static and dynamic planning in the same worlds: benefit and cost of replanning.

Both rovers have the floor plan of the world as it was built, observe moving things by their
cameras, and steer alike. The static one plans its path once and stops before an obstacle; the
dynamic one repairs its path with D* Lite.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP, LABEL_GROUP
from sim.world.rover import BODY
from sim.world.world import World
from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.trial_results import Metrics, Result
from trials.gym.studies.trial_runner import rover_nav
from trials.gym.world.free_space import NO_GEOM, FreeSpace
from trials.navigation.occupancy_grid import OccupancyGrid, empty_grid
from trials.navigation.planner import GridPlanner
from trials.navigation.settings import NavigatorSettings
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.settings import amended

Planning = Literal["static", "dynamic"]
PLANNINGS: tuple[Planning, ...] = get_args(Planning)
SETTINGS = amended(NavigatorSettings(), {"initial_turn_deg": 0.0, "occupancy.max_depth_m": 3.0})
"""With a floor plan only changes are new: no initial turn, and a short range."""
IDEAL_SETTINGS = SETTINGS.model_copy(update={"min_speckle_px": 0})
IDEAL_CHANNELS = ("pose", "goal")
DEPTH_PX, MAX_RAY_M = (64, 48), 8.0
"""Width and height of ideal disparity, and longest distance."""


@dataclass(frozen=True)
class PlanningResult(Result):
    """Result of a trial with static or dynamic planning.

    `spl` is success weighted by path length, `plans` counts plans and repairs, `expanded` the cells
    that D* Lite expanded, and `cpu_ms` is the processor time of planning.
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
    """Parse `static,dynamic`; raises a SettingsError if a kind is unknown, or there is none."""
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

    As `trial_runner.run_world`; `ideal` is depth by rays in place of cameras, so that nothing but
    planning can fail.
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
    x_m, y_m = space.points(np.array([(0, 0), (height - 1, width - 1)])).T.tolist()
    grid = empty_grid(x_m, y_m, settings.cell_m)
    points_m = space.points(np.argwhere(space.obstacles != NO_GEOM))
    columns, rows = np.round((points_m - space.origin) / settings.cell_m).astype(int).T
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
    planner = policy.navigator.planner
    return PlanningResult(
        layout=layout,
        run=run,
        localization=env.trial.localization,
        **{key: info[key] for key in ("outcome", "time_s", "driven_m", "way_m", "spl")},
        planning=planning,
        plans=planner.plans,
        expanded=planner.expanded,
        cpu_ms=1e3 * planner.cpu_s,
    )


def ray_disparity(world: World) -> Array:
    """Cast rays at collision shapes in place of a stereo pair; what the rover hides is unknown.

    Returns:
        (DEPTH_PX[1], DEPTH_PX[0]) disparity in pixels of the full image; 0 where nothing is near.
    """
    world.place_bodies()
    rig, model = world.rig, world.model
    width, height = DEPTH_PX
    u = (np.arange(width) + 0.5) * rig.width_px / width - 0.5
    v = (np.arange(height) + 0.5) * rig.height_px / height - 0.5
    x, y = np.meshgrid((u - rig.cx_px) / rig.f_px, (v - rig.cy_px) / rig.f_px)
    rays_cam = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    lengths = np.linalg.norm(rays_cam, axis=1)
    T_world_cam = world.T_world_cam
    rays = (rays_cam / lengths[:, None]) @ T_world_cam[:3, :3].T
    collides = np.ones(6, np.uint8)
    collides[[IMAGE_GROUP, LABEL_GROUP]] = 0
    geoms, distances_m = np.full(len(rays), -1, np.int32), np.zeros(len(rays))
    mujoco.mj_multiRay(
        model, world.data, T_world_cam[:3, 3], rays.ravel(), collides, 1, model.body(BODY).id,
        geoms, distances_m, None, len(rays), MAX_RAY_M,
    )  # fmt: skip
    is_rover = model.body_rootid[model.geom_bodyid[geoms]] == model.body(BODY).rootid[0]
    depth_m = np.where((geoms >= 0) & ~is_rover, distances_m / lengths, np.inf)
    return (rig.f_px * rig.baseline_m / depth_m).reshape(height, width)
