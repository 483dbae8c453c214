"""`driftyard trial-memory`: memory of an environment over many resets."""

from typing import Annotated

import typer

from trials.cli import console
from trials.gym.studies.memory import memory_over_resets


def trial_memory(
    scene: Annotated[
        str, typer.Argument(help="Registered scene, MJCF file or module:function.")
    ] = "turntable",
    resets: Annotated[int, typer.Option(min=2, help="Number of worlds to build.")] = 100,
) -> None:
    """Build world after world, render one image in each, and print the memory of the process."""
    for worlds, memory_mb in memory_over_resets(scene, resets):
        console.out.print(f"{worlds:5d} worlds  {memory_mb:8.1f} MB")
