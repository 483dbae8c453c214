"""`driftyard trial-speed`: steps per second of a navigation environment."""

import os

from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.studies.speed import CASES, SHARED, rate_hz, scaling
from trials.report.tables import text_table


def trial_speed(
    scene: str = argument("warehouse", "Registered scene, MJCF file or module:function."),
    workers: bool = option(True, "Also measure two workers at once."),
) -> None:
    """Measure steps per second of processor time, and the scaling to two cores."""
    rows = [(x.name, f"{rate_hz(x, scene):.0f}", f"{x.promised_hz:.0f}") for x in CASES]
    cores = sorted(os.sched_getaffinity(0))[:2]
    if workers and len(cores) == 2:
        ratio = scaling(SHARED, scene, cores)
        rows.append(("two workers over one, each on its core", f"{ratio:.2f}", "1.6"))
    console.out.print(text_table(("a step of", "steps/s of one core", "promised"), rows))
