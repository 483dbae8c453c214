"""How fast trials step, on one core and on two; `driftyard trial-speed`.

Rates are steps in a second of processor time, all threads of the process together: what one core
gives a worker, however busy the machine is. The scaling is of wall-clock time.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from time import perf_counter, process_time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv

import trials.gym
from vo.contract.arrays import Array

NAV = next(iter(trials.gym.ENVIRONMENTS))
COMMAND: Array = np.array([0.0, 0.5], np.float32)
"""Turning on the spot: always possible, and every picture is another."""
ROUNDS = 5
"""The best one counts."""


@dataclass(frozen=True)
class Case:
    """What is measured.

    Attributes:
        name: For the table.
        options: Of the environment.
        steps: In a round.
        goal_hz: Steps a second that are promised on one core.
    """

    name: str
    options: Mapping[str, Any]
    steps: int
    goal_hz: float


SMALL = {"rig.width_px": 320, "rig.height_px": 240}
CASES = (
    Case(
        "physics alone, steps of 20 ms",
        {"observe": ("goal",), "localization": "truth", "rate_hz": 50.0},
        1000,
        2000.0,
    ),
    Case("stereo images, 320 x 240", {"localization": "truth", "settings": SMALL}, 40, 40.0),
    Case("visual odometry, 640 x 480", {"localization": "vo", "observe": ("goal",)}, 20, 10.0),
)
SHARED = CASES[1]
"""What two workers are measured with."""


def rate_hz(case: Case, scene: str) -> float:
    """Steps in a second of processor time."""
    env = gymnasium.make(
        NAV, disable_env_checker=True, scene=scene, time_limit_s=3600.0, **case.options
    )
    env.reset(seed=0)
    env.step(COMMAND)
    best = 0.0
    for _ in range(ROUNDS):
        start = process_time()
        for _ in range(case.steps):
            env.step(COMMAND)
        best = max(best, case.steps / (process_time() - start))
    env.close()
    return best


def scaling(case: Case, scene: str, cores: list[int]) -> float:
    """Steps of a worker on each core over those of one alone, in the same wall-clock time.

    Of each arrangement the quickest step counts, for which nobody else had the cores.
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
    envs = AsyncVectorEnv([partial(_held_to, core, options) for core in cores], context="spawn")
    envs.reset(seed=[0 for _ in cores])
    envs.step(np.tile(COMMAND, (len(cores), 1)))
    return envs


def _held_to(core: int, options: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make an environment in a process that has one core from here on."""
    os.sched_setaffinity(0, [core])
    os.environ["LP_NUM_THREADS"] = "1"  # of the software renderer
    return gymnasium.make(NAV, disable_env_checker=True, **options)
