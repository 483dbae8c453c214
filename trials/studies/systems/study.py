"""The whole comparison: recordings, runs, and trajectories of programs that ran elsewhere."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from sim.camera_names import DEFAULT_CAMERA
from trials.estimators.systems.environments import SYSTEMS
from trials.execution.cache import CACHE
from trials.execution.jobs import Recording, Variant
from trials.execution.progress import ProgressBar, counted, no_progress
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import NO_LABELS, record_all
from trials.execution.variants import parse_estimators, repeated
from trials.studies.benchmark import machine
from trials.studies.systems.comparison import About, SystemComparison
from trials.studies.systems.measuring import Drive, measure, parse_added, read_added
from vo.contract.errors import SettingsError

EVERY = ("driftyard", "corner_flow", *SYSTEMS)
"""Estimators by default."""


@dataclass(frozen=True)
class Plan:
    """What is compared.

    Attributes:
        estimators: Names `a,b`, or `NAME KEY=VALUE ...`.
        scenes: Names of scenes `a,b`, or all.
        seeds: Number of drives in each scene.
        repeats: Number of runs of an estimator with a seed of RANSAC, or with varying results.
        distance_m: Length of each drive.
        overrides: Further settings of the recordings.
        disturb: Disturbances of the recordings.
        camera: Camera of the recordings.
        added: `NAME=FOLDER` of trajectory files of other programs.
        jobs: Number of runs at a time, each on one core.
        cache: Folder of recordings and runs.
    """

    estimators: Sequence[str] = EVERY
    scenes: str = "all"
    seeds: int = 3
    repeats: int = 3
    distance_m: float = 10.0
    overrides: Sequence[str] = ()
    disturb: str = ""
    camera: str = DEFAULT_CAMERA
    added: Sequence[str] = ()
    jobs: int = 1
    cache: Path = field(default=CACHE)


def compare_systems(
    plan: Plan, command: str = "", bar: ProgressBar = no_progress
) -> SystemComparison:
    """Record or reuse the drives, run what the cache lacks, and compare.

    Raises:
        DriftyardError: If a scene, setting, estimator or folder is wrong: before anything is run.
    """
    scenes, added = parse_scenes(plan.scenes), parse_added(plan.added)
    variants = {x.label: x for x in parse_estimators(plan.estimators)}
    if both := variants.keys() & added.keys():
        raise SettingsError(f"--add {min(both)}: the name is that of an estimator")
    drives = _record(plan, scenes, bar)
    systems = {name: repeated(x, plan.repeats) for name, x in variants.items()}
    given = [x for name, folder in added.items() for x in read_added(name, folder, drives)]
    with counted(bar, "runs", len(drives) * sum(map(len, systems.values()))) as count:
        trials = measure(drives, systems, count, plan.jobs, plan.cache)
    about = {name: _about(x) for name, x in variants.items()}
    about |= {name: About(f"trajectory files of {folder}") for name, folder in added.items()}
    load = os.getloadavg()[0]
    return SystemComparison(tuple(drives), about, (*trials, *given), command, machine(), load)


def _record(plan: Plan, scenes: Sequence[str], bar: ProgressBar) -> list[Drive]:
    settings = (f"drive.distance_m={plan.distance_m:g}", *NO_LABELS, *plan.overrides)
    pairs = list(product(scenes, range(plan.seeds)))
    recordings = [Recording(*x, settings, plan.disturb, plan.camera) for x in pairs]
    with counted(bar, "drives", len(recordings)) as count:
        folders = record_all(recordings, plan.cache, count)
    return [Drive(*x, folder.resolve()) for x, folder in zip(pairs, folders, strict=True)]


def _about(variant: Variant) -> About:
    chosen = ", ".join(variant.overrides)
    package = SYSTEMS.get(variant.estimator)
    if package is None:
        return About(f"{variant.estimator}; {chosen}" if chosen else variant.estimator)
    what = f"{package.about}; {chosen}" if chosen else package.about
    return About(what, package.license, package.requirements[0])
