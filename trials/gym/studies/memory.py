"""Memory of an environment over many resets, each to another world."""

from collections.abc import Iterator

from trials.execution.process_memory import resident_mb
from trials.gym.studies.trial_runner import rover_nav


def memory_over_resets(scene: str, resets: int) -> Iterator[tuple[int, float]]:
    """Build world after world and render one image in each.

    Yields:
        Number of worlds and memory of the process, MB, ten times and at the end.
    """
    with rover_nav({"scene": scene, "localization": "truth"}) as env:
        for k in range(resets):
            env.reset(options={"layout": k})
            env.step(env.action_space.sample())
            if k % max(1, resets // 10) == 0 or k == resets - 1:
                yield k + 1, resident_mb()
