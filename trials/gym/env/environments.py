"""The three environments: reach a goal, follow a route, explore and return."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from trials.gym.env.rover_env import RoverEnv
from trials.gym.env.settings import ExploreSettings, NavSettings, RouteSettings
from trials.gym.env.tasks import Explore, FollowRoute, ReachGoal, Task
from trials.gym.world.dynamic_agents import Reacting
from trials.gym.world.dynamics import draw_dynamics
from trials.gym.world.scene_instance import Site, relaid
from trials.gym.world.start_goal_sampling import Errand, TrialError, check_place, draw_errand
from vo.contract.arrays import Array


class RoverNav(RoverEnv):
    """Reach a goal by any way; `reset` takes a `start` and a `goal` of one's own."""

    model = NavSettings
    trial: NavSettings

    def _assign(self, site: Site, options: Mapping[str, Any]) -> tuple[Site, Task]:
        start, goal = _place(options, "start", 3), _place(options, "goal", 2)
        _refuse_others(options, ("start", "goal"))
        trial, rng = self.trial, self.np_random
        errand = draw_errand(site.passages, site.part, trial.distance_m, rng, start, goal)
        stage, movers = site, self._movers(site, errand)
        if site.follows_way or movers:
            stage = relaid(site, trial, errand, movers)
        return stage, ReachGoal(errand, trial.goal_radius_m)

    def _movers(self, site: Site, errand: Errand) -> dict[str, Reacting]:
        """What moves on the way, by name."""
        trial = self.trial
        if not trial.dynamics:
            return {}
        seed = int(self.np_random.integers(2**31))
        text, speed_mps = trial.dynamics, trial.speed_max_mps
        return draw_dynamics(site.scene, site.passages, errand, speed_mps, text, seed)


class RoverRoute(RoverEnv):
    """Follow a route of the scene to its end."""

    model = RouteSettings
    trial: RouteSettings

    def _assign(self, site: Site, options: Mapping[str, Any]) -> tuple[Site, Task]:
        _refuse_others(options, ())
        path, trial = site.simulation.world.path, self.trial
        check_place(site.passages, "start", path.waypoints[0])
        return site, FollowRoute(path, trial.stray_m, trial.goal_radius_m, trial.lookahead_m)


class RoverExplore(RoverEnv):
    """Bring a share of the open ground into view and return to the start."""

    model = ExploreSettings
    trial: ExploreSettings

    def _assign(self, site: Site, options: Mapping[str, Any]) -> tuple[Site, Task]:
        start = _place(options, "start", 3)
        _refuse_others(options, ("start",))
        trial, passages = self.trial, site.passages
        if start is None:
            errand = draw_errand(passages, site.part, (trial.view_m, np.inf), self.np_random)
            start = errand.start
        else:
            check_place(passages, "start", start[:2])
        part = passages.parts == passages.parts[tuple(passages.free.cells(start[:2]))]
        task = Explore(passages, part, start, trial.cover_share, trial.view_m, trial.goal_radius_m)
        return site, task


def _place(options: Mapping[str, Any], name: str, size: int) -> Array | None:
    """A place of a reset's options.

    Raises:
        TrialError: If it is not so many finite numbers.
    """
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
