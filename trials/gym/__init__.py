"""Closed-loop trials as Gymnasium environments; importing this package registers them."""

from gymnasium.envs.registration import register, registry

ENVIRONMENTS = {
    "driftyard/RoverNav-v0": "trials.gym.env.environments:RoverNav",
    "driftyard/RoverRoute-v0": "trials.gym.env.environments:RoverRoute",
    "driftyard/RoverExplore-v0": "trials.gym.env.environments:RoverExplore",
}


def register_environments() -> None:
    """Tell Gymnasium of the environments, once; also the entry point of its plug-ins."""
    for name, where in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=where)


register_environments()
