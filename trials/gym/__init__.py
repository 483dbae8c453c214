"""Closed-loop trials as Gymnasium environments; importing this package registers them."""

from gymnasium.envs.registration import WrapperSpec, register, registry

ENVIRONMENTS = {
    "driftyard/RoverNav-v0": ("trials.gym.env.environments:RoverNav", 11.0),
    "driftyard/RoverRoute-v0": ("trials.gym.env.environments:RoverRoute", 44.0),
    "driftyard/RoverExplore-v0": ("trials.gym.env.environments:RoverExplore", 68.0),
}
"""Identifier to the class, and the mean return from which on the task counts as solved.

`docs/environments` says how the returns were measured.
"""
MAX_STEPS = 1800
"""Steps of a trial with the default options: 120 s at 15 Hz."""


def register_environments() -> None:
    """Tell Gymnasium of the environments, once; also the entry point of its plug-ins."""
    limit = WrapperSpec("with_own_time_limit", "trials.gym.env.time_limit:with_own_time_limit", {})
    for name, (where, reward_threshold) in ENVIRONMENTS.items():
        if name not in registry:
            register(
                id=name,
                entry_point=where,
                reward_threshold=reward_threshold,
                nondeterministic=False,
                max_episode_steps=MAX_STEPS,
                additional_wrappers=(limit,),
            )


register_environments()
