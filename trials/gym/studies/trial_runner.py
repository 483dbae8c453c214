"""The fleet: drives the trials of many worlds, two worlds at a time."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import trials.gym
from sim.preview.film import writing
from trials.evaluation.alignment import Pair
from trials.evaluation.metrics import errors_over_distance
from trials.execution.parallel import map_parallel
from trials.gym.env.environments import RoverNav
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.studies.trial_protocol import Trial
from vo.contract.arrays import Array

NAV = next(iter(trials.gym.ENVIRONMENTS))


def run_trials(
    options: Mapping[str, Any],
    sources: Sequence[str],
    layouts: Sequence[int],
    runs: int,
    keep: Path | None = None,
) -> Iterator[list[Trial]]:
    """Drive in every world with every source, from the same starts to the same goals.

    Args:
        options: Of RoverNav; `observe` must hold what the navigator needs.
        sources: As `localization`.
        layouts: Seeds of the worlds.
        runs: Pairs of start and goal in each.
        keep: Folder for a film and a dataset of every trial, `layout-run-source`; none: neither.

    Yields:
        The trials of a world, as worlds are done with.

    Raises:
        DriftyardError: If an option is refused or a world has no free place.
    """
    calls = [(dict(options), sources, k, runs, keep) for k in layouts]
    for _, of_world in map_parallel(drive_world, calls):
        yield of_world


def drive_world(
    options: Mapping[str, Any],
    sources: Sequence[str],
    layout: int,
    runs: int,
    keep: Path | None = None,
) -> list[Trial]:
    """Drive every run of one world with every source; see `run_trials`."""
    render_mode = "rgb_array" if keep else None
    options = {**options, "record": keep is not None}
    env = gymnasium.make(NAV, render_mode=render_mode, disable_env_checker=True, **options)
    rover = env.unwrapped
    assert isinstance(rover, RoverNav)
    try:
        return [
            _drive(rover, layout, run, layout * runs + run, source, keep)
            for run in range(runs)
            for source in sources
        ]
    finally:
        env.close()


def _drive(
    env: RoverNav, layout: int, run: int, seed: int, source: str, keep: Path | None
) -> Trial:
    observation, info = env.reset(seed=seed, options={"layout": layout, "localization": source})
    policy = NavigatorPolicy(env)
    told = [info]
    name = f"{layout}-{run}-{source.replace(':', '_')}"
    with _filming(env, keep and keep / f"{name}.mp4") as film:
        film()
        while not info["outcome"]:
            observation, _, _, _, info = env.step(policy.act(observation))
            told.append(info)
            film()
    if keep:
        env.save_dataset(keep / name)
    return Trial(
        layout,
        run,
        source,
        info["outcome"],
        info["time_s"],
        info["driven_m"],
        info["way_m"],
        info["left_m"],
        info["way_m"] / env.trial.speed_max_mps,
        info["error_m"],
        drift_percent(told),
        sum(x["status"] == "lost" for x in told) / len(told),
    )


@contextmanager
def _filming(env: RoverNav, out: Path | None) -> Generator[Callable[[], None]]:
    """Yield what adds a picture of the present to a film, if there is to be one."""
    if out is None:
        yield lambda: None
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    with writing(out, env.trial.rate_hz) as show:
        yield lambda: show(np.asarray(env.render(), np.uint8))


def drift_percent(told: Sequence[Mapping[str, Any]]) -> float | None:
    """Mean drift over 1 m of what the steps of a trial told; None if the path is shorter."""
    times_ns: Array = np.array([round(1e9 * x["time_s"]) for x in told])
    T_true, T_estimated = (np.array([x[key] for x in told]) for key in ("T_true", "T_estimated"))
    errors = errors_over_distance(Pair(times_ns, T_true, T_estimated), 1.0)
    return 100 * float(errors.translation_m.mean()) if len(errors) else None
