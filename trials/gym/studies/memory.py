"""Memory over many resets, each to another world: python -m trials.gym.studies.memory."""

from typing import Annotated

import gymnasium
import typer

import trials.gym
from trials.studies.speed.resident import resident_mb


def main(
    scene: Annotated[str, typer.Argument(help="Name, MJCF file or module:function.")] = "turntable",
    resets: Annotated[int, typer.Option(min=2, help="Worlds to build, one after the other.")] = 100,
) -> None:
    """Build world after world, take one picture in each, and print the memory in between."""
    env = gymnasium.make(
        next(iter(trials.gym.ENVIRONMENTS)), scene=scene, localization="truth", layout=None
    )
    for k in range(resets):
        env.reset(options={"layout": k})
        env.step(env.action_space.sample())
        if k % max(1, resets // 10) == 0 or k == resets - 1:
            print(f"{k + 1:5d} worlds  {resident_mb():8.1f} MB", flush=True)
    env.close()


if __name__ == "__main__":
    typer.run(main)
