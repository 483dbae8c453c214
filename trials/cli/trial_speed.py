"""`driftyard trial-speed`: steps per second of a navigation environment.

Rates are steps per second of processor time, all threads of the process together: the rate of one
core, however busy the machine is. The scaling is of wall-clock time.
"""

import os
from collections.abc import Mapping
from functools import partial
from time import perf_counter, process_time
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv

from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.studies.trial_runner import NAV, rover_nav
from trials.report.tables import text_table
from vo.contract.arrays import Array

COMMAND: Array = np.array([0.0, 0.5], np.float32)
"""Turn on the spot: always possible, and every image differs."""
ROUNDS = 5
"""Repetitions, of which the best counts."""


class Case(NamedTuple):
    """Row of the table, options of the environment, steps of a round and promised steps/s."""

    name: str
    options: Mapping[str, Any]
    steps: int
    promised_hz: float


PHYSICS = {"observe": ("goal",), "localization": "truth", "rate_hz": 50.0}
IMAGES = {"localization": "truth", "settings": {"rig.width_px": 320, "rig.height_px": 240}}
CASES = (
    Case("physics alone, steps of 20 ms", PHYSICS, 1000, 2000.0),
    Case("stereo images, 320 x 240", IMAGES, 40, 40.0),
    Case("visual odometry, 640 x 480", {"localization": "vo", "observe": ("goal",)}, 20, 10.0),
)


def trial_speed(
    scene: str = argument("warehouse", "Registered scene, MJCF file or module:function."),
    workers: bool = option(True, "Also measure two workers at once."),
) -> None:
    """Measure steps per second of processor time, and the scaling to two cores."""
    rows = [(x.name, f"{_rate_hz(x, scene):.0f}", f"{x.promised_hz:.0f}") for x in CASES]
    cores = sorted(os.sched_getaffinity(0))[:2]
    if workers and len(cores) == 2:
        ratio = _scaling(CASES[1], scene, cores)
        rows.append(("two workers over one, each on its core", f"{ratio:.2f}", "1.6"))
    console.out.print(text_table(("a step of", "steps/s of one core", "promised"), rows))


def _rate_hz(case: Case, scene: str) -> float:
    """Measure steps per second of processor time."""
    with rover_nav({"scene": scene, "time_limit_s": 3600.0, **case.options}) as env:
        env.reset(seed=0)
        env.step(COMMAND)
        best = 0.0
        for _ in range(ROUNDS):
            start = process_time()
            for _ in range(case.steps):
                env.step(COMMAND)
            best = max(best, case.steps / (process_time() - start))
    return best


def _scaling(case: Case, scene: str, cores: list[int]) -> float:
    """Measure the steps of one worker for each core over those of one alone, in wall-clock time.

    The quickest step of each arrangement counts, during which no other process had the cores.
    """
    alone, together = (_workers(case, scene, some) for some in (cores[:1], cores))
    best_s = [np.inf, np.inf]
    try:
        for _ in range(ROUNDS):
            for k, envs in enumerate((alone, together)):
                actions = np.tile(COMMAND, (envs.num_envs, 1))
                for _ in range(case.steps):
                    start = perf_counter()
                    envs.step(actions)
                    best_s[k] = min(best_s[k], perf_counter() - start)
    finally:
        alone.close()
        together.close()
    return len(cores) * float(best_s[0] / best_s[1])


def _workers(case: Case, scene: str, cores: list[int]) -> AsyncVectorEnv:
    options = {**case.options, "scene": scene, "time_limit_s": 3600.0}
    envs = AsyncVectorEnv([partial(_pinned, core, options) for core in cores], context="spawn")
    envs.reset(seed=[0 for _ in cores])
    envs.step(np.tile(COMMAND, (len(cores), 1)))
    return envs


def _pinned(core: int, options: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make an environment in a process that is pinned to one core."""
    os.sched_setaffinity(0, [core])
    os.environ["LP_NUM_THREADS"] = "1"  # of the software renderer
    return gymnasium.make(NAV, disable_env_checker=True, **options)
