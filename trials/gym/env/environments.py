"""The three environments: reach a goal, follow a route, explore and return."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sim.settings import TerrainSettings
from trials.gym.env.rover_env import Assignment, RoverEnv
from trials.gym.env.settings import ExploreSettings, NavSettings, RouteSettings
from trials.gym.env.tasks import Explore, FollowRoute, ReachGoal
from trials.gym.world.dynamic_agents import DynamicAgent
from trials.gym.world.dynamics import sample_dynamics
from trials.gym.world.scene_instance import SceneInstance, rebuilt_along
from trials.gym.world.start_goal_sampling import (
    TrialError,
    expect_clear,
    expect_route,
    expect_start,
    sample_start_goal,
)
from vo.contract.arrays import Array


class RoverNav(RoverEnv):
    """Reach a goal by any path; `reset` accepts a `start` and a `goal`."""

    model = NavSettings
    trial: NavSettings

    def _assign(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        start, goal = _place(options, "start", 3), _place(options, "goal", 2)
        _refuse_others(options, ("start", "goal"))
        trial, rng = self.trial, self.np_random
        ends = sample_start_goal(
            base.traversable, base.component, trial.distance_m, rng, start, goal
        )
        instance: SceneInstance = base
        agents: Mapping[str, DynamicAgent] = {}
        if trial.dynamics:
            seed = int(rng.integers(2**31))
            agents = sample_dynamics(base.scene, ends, trial.speed_max_mps, trial.dynamics, seed)
        if agents or base.settings.terrain != TerrainSettings():  # it lies along the path
            instance = rebuilt_along(base, ends.path, agents)
        return instance, ReachGoal(ends, trial.goal_radius_m)


class RoverRoute(RoverEnv):
    """Follow a route of the scene to its end."""

    model = RouteSettings
    trial: RouteSettings

    def _assign(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        _refuse_others(options, ())
        path = base.simulation.world.path
        expect_clear(base.traversable, "start", path.waypoints[0])
        steps = np.arange(0, path.length_m, base.traversable.space.cell_m)
        expect_route(base.traversable, path.at(np.append(steps, path.length_m)))
        return base, FollowRoute(path, self.trial)


class RoverExplore(RoverEnv):
    """Bring a fraction of the reachable ground into view and return to the start."""

    model = ExploreSettings
    trial: ExploreSettings

    def _assign(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        start = _place(options, "start", 3)
        _refuse_others(options, ("start",))
        traversable = base.traversable
        if start is None:
            distance_m = (self.trial.view_m, np.inf)
            ends = sample_start_goal(traversable, base.component, distance_m, self.np_random)
            start = ends.start
        else:
            expect_start(traversable, start[:2])
        return base, Explore(traversable, start, self.trial)


def _place(options: Mapping[str, Any], name: str, size: int) -> Array | None:
    """Return so many finite numbers of a reset's options; raises a TrialError if they are not."""
    if options.get(name) is None:
        return None
    try:
        place = np.array(options[name], dtype=float)
    except (TypeError, ValueError):
        place = np.zeros(0)
    if place.shape != (size,) or not np.isfinite(place).all():
        wanted = "x, y, yaw" if size == 3 else "x, y"
        raise TrialError(f"{name} {options[name]!r}: expected ({wanted}), metres and radians")
    return place


def _refuse_others(options: Mapping[str, Any], valid: tuple[str, ...]) -> None:
    unknown = sorted(set(options) - set(valid))
    if unknown:
        said = ", ".join(("layout", "localization", *valid))
        raise TrialError(f"reset: unknown option {', '.join(unknown)}; valid: {said}")
