"""`driftyard trial-memory`: memory of an environment over many resets."""

from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.studies.memory import memory_over_resets


def trial_memory(
    scene: str = argument("turntable", "Registered scene, MJCF file or module:function."),
    resets: int = option(100, "Number of worlds to build.", min=2),
) -> None:
    """Build world after world, render one image in each, and print the memory of the process."""
    for worlds, memory_mb in memory_over_resets(scene, resets):
        console.out.print(f"{worlds:5d} worlds  {memory_mb:8.1f} MB")
