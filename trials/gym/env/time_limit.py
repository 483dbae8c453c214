"""The limit of steps, of which Gymnasium keeps one for all options of an environment."""

from typing import Any

from gymnasium import Env
from gymnasium.wrappers import TimeLimit

from trials.gym import MAX_STEPS
from trials.gym.env.rover_env import RoverEnv


def with_own_time_limit(env: Env[Any, Any]) -> Env[Any, Any]:
    """Limit an environment, as `gymnasium.make` has wrapped it, by its `time_limit_s`.

    This replaces the registered limit of steps; another one that `gymnasium.make` was given is
    kept, and so is none.
    """
    rover, limit = env.unwrapped, env.spec.max_episode_steps if env.spec else None
    if isinstance(env, TimeLimit) and isinstance(rover, RoverEnv) and limit == MAX_STEPS:
        return TimeLimit(env.env, rover.trial.max_steps)
    return env
