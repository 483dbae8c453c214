"""Steps per second of a navigation environment, with the truth and with visual odometry."""

import os
from time import perf_counter, process_time

import gymnasium
import numpy as np
from rich.table import Table

from trials.report.tables import text_table
from trials.studies.speed.drive import on_cores
from vo.contract.arrays import Array

ENVIRONMENT, SCENE = "driftyard:driftyard/RoverNav-v0", "warehouse"
SETTINGS = {"rig.width_px": 320, "rig.height_px": 240}
CURVE: Array = np.array([0.3, 0.5], np.float32)
"""Drive in a circle of 0.3 m: every image differs, and there is room for it."""
STEPS, QUICK_STEPS, WARM_STEPS = 150, 40, 15
REQUIRED = {"truth": "", "vo": "≥ 20"}
"""Source of localization to the steps per second that one core must reach."""


def measure_steps(localization: str, steps: int) -> Array:
    """Measure wall and processor time (steps, 2) of each step, ms, on the cores of this process."""
    os.environ["LP_NUM_THREADS"] = str(len(os.sched_getaffinity(0)))  # of the software renderer
    options = {"scene": SCENE, "settings": SETTINGS, "localization": localization}
    seconds: list[tuple[float, float]] = []
    env = gymnasium.make(ENVIRONMENT, disable_env_checker=True, time_limit_s=3600.0, **options)
    env.reset(seed=0)
    for _ in range(WARM_STEPS + steps):
        start = perf_counter(), process_time()
        _, _, is_over, _, _ = env.step(CURVE)
        seconds.append((perf_counter() - start[0], process_time() - start[1]))
        if is_over:
            env.reset()
    env.close()
    return 1e3 * np.array(seconds[WARM_STEPS:])


def environment_table(cores: list[int], steps: int) -> Table:
    """Tabulate steps per second of mean steps: of processor time, and on one core and on two.

    The former is the rate of one core, however busy the machine is.
    """
    rows: list[tuple[str, ...]] = []
    for localization, required in REQUIRED.items():
        one, two = (
            on_cores(some, measure_steps, localization, steps) for some in (cores[:1], cores[:2])
        )
        means_ms = one[:, 1].mean(), one[:, 0].mean(), two[:, 0].mean()
        processor, *walls = (f"{1e3 / x:.1f}" for x in means_ms)
        rows.append((localization, processor, required, *walls))
    title = f"{SCENE}, 320 × 240, steps/s"
    header = (title, "of processor time", "required", "1 core, wall", "2 cores, wall")
    return text_table(header, rows)
