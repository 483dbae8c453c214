"""Memory over many resets, each to another world, as a command: python -m trials.gym.memory."""

from pathlib import Path
from typing import Annotated

import gymnasium
import typer

import trials.gym

PAGE_BYTES = 4096


def resident_mb() -> float:
    """Memory of this process that is in RAM now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


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
