"""`driftyard trial-memory`: memory of an environment over many resets."""

from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.studies.trial_runner import rover_nav
from trials.studies.speed.estimator import resident_mb


def trial_memory(
    scene: str = argument("turntable", "Registered scene, MJCF file or module:function."),
    resets: int = option(100, "Number of worlds to build.", min=2),
) -> None:
    """Build world after world, render one image in each, and print the memory of the process."""
    with rover_nav({"scene": scene, "localization": "truth"}) as env:
        for k in range(resets):
            env.reset(options={"layout": k})
            env.step(env.action_space.sample())
            if k % max(1, resets // 10) == 0 or k == resets - 1:
                console.out.print(f"{k + 1:5d} worlds  {resident_mb():8.1f} MB")
