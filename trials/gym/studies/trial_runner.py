"""Runs the trials of one world with every source of localization."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import trials.gym
from trials.evaluation.alignment import Pair
from trials.evaluation.metrics import errors_over_distance
from trials.gym.env.environments import RoverNav
from trials.gym.env.episode import Observation
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.media import Filmed
from trials.gym.studies.live_trial import live_trial
from trials.gym.studies.trial_results import TrialResult
from trials.view.target import Target
from vo.contract.arrays import Array

Show = Callable[[Observation, Mapping[str, Any]], None]
"""Shows an observation and an info."""
NAV = next(iter(trials.gym.ENVIRONMENTS))
FROM_INFO = ("outcome", "time_s", "driven_m", "way_m", "left_m", "error_m")
"""Entries of the last info that are kept."""


def run_world(
    options: Mapping[str, Any],
    sources: Sequence[str],
    layout: int,
    runs: int,
    keep: Path | None = None,
    view: Target | None = None,
) -> list[TrialResult]:
    """Run trials in one world with every source, from the same starts to the same goals.

    Options are those of RoverNav; `observe` must hold what the navigator needs. `keep` is a folder
    for a film and a dataset of every trial, `layout-run-source`; `view` is a viewer that shows
    each trial, or a folder for a file of each.

    Raises:
        DriftyardError: If an option is refused or the world has no traversable place.
    """
    render_mode = "rgb_array" if keep else None
    if view:
        options = {**options, "observe": (*options["observe"], "left", "right")}
    with rover_nav({**options, "record": keep is not None, "render_mode": render_mode}) as env:
        return [
            _run(env, layout, run, layout * runs + run, source, keep, view)
            for run in range(runs)
            for source in sources
        ]


@contextmanager
def rover_nav(options: Mapping[str, Any]) -> Generator[RoverNav]:
    """Make RoverNav without wrappers, and close it afterwards."""
    env = gymnasium.make(NAV, disable_env_checker=True, **options)
    rover = env.unwrapped
    assert isinstance(rover, RoverNav)
    try:
        yield rover
    finally:
        env.close()


def _run(
    env: RoverNav,
    layout: int,
    run: int,
    seed: int,
    source: str,
    keep: Path | None,
    view: Target | None,
) -> TrialResult:
    name = f"{layout}-{run}-{source.replace(':', '_')}"
    filmed = Filmed(env, keep / f"{name}.mp4") if keep else env
    options = {"layout": layout, "localization": source}
    observation, info = filmed.reset(seed=seed, options=options)
    policy, infos = NavigatorPolicy(env), [info]
    with _shown(env, name, view) as shown:
        shown(observation, info)
        while not info["outcome"]:
            observation, _, _, _, info = filmed.step(policy.act(observation))
            infos.append(info)
            shown(observation, info)
    if keep:
        env.save_dataset(keep / name)
    return TrialResult(
        layout=layout,
        run=run,
        localization=source,
        **{key: info[key] for key in FROM_INFO},
        optimal_s=info["way_m"] / env.trial.speed_max_mps,
        drift_percent=drift_percent(infos),
        lost_share=sum(x["status"] == "lost" for x in infos) / len(infos),
    )


@contextmanager
def _shown(env: RoverNav, name: str, view: Target | None) -> Generator[Show]:
    """Yield what shows each step of a trial; it does nothing without a viewer."""
    if view is None:
        yield lambda _observation, _info: None
        return
    target = replace(view, file=view.file / f"{name}.rrd") if view.file else view
    with live_trial(env, name, target) as live:
        yield live.add


def drift_percent(infos: Sequence[Mapping[str, Any]]) -> float | None:
    """Mean drift over 1 m from the infos of all steps; None if the path is shorter."""
    times_ns: Array = np.array([round(1e9 * x["time_s"]) for x in infos])
    T_true, T_estimated = (np.array([x[key] for x in infos]) for key in ("T_true", "T_estimated"))
    errors = errors_over_distance(Pair(times_ns, T_true, T_estimated), 1.0)
    return 100 * float(errors.translation_m.mean()) if len(errors) else None
