"""Runs of systems over recordings, one at a time on one core each; failures cost one run only."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trials.estimators.plugins.command import between_keyframes
from trials.estimators.systems.environments import SYSTEMS, python_of
from trials.evaluation.dataset_scores import score_runs
from trials.evaluation.runs import SavedRun, read_run
from trials.evaluation.score import Score
from trials.execution.cache import CACHE
from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.jobs import Job, Recording, Result, Variant, scene_label
from trials.execution.runner import cached_run
from trials.execution.tasks import Task
from vo.contract.arrays import Indices
from vo.contract.errors import DriftyardError, SettingsError
from vo.contract.remarks import remark
from vo.recordings.readers import read_frame_times
from vo.recordings.trajectory_files import SAME_TIME_NS

ONE_CORE = "one core"
"""Condition of these runs in the cache."""


@dataclass(frozen=True)
class Drive:
    """A recording: scene and seed, and its folder."""

    scene: str
    seed: int
    dataset: Path

    @property
    def name(self) -> str:
        """Name in tables, and of trajectory files of other programs."""
        return f"{scene_label(self.scene)}-{self.seed}"


@dataclass(frozen=True)
class Trial:
    """One run of a system over a drive: a score and lost frames, or the problem.

    Attributes:
        lost_percent: Frames without a pose; those that a program leaves out between keyframes do
            not count.
    """

    drive: str
    scene: str
    system: str
    score: Score | None
    lost_percent: float | None
    problem: str = ""


def measure(
    drives: Sequence[Drive],
    systems: Mapping[str, Sequence[Variant]],
    progress: Callable[[object], None],
    jobs: int = 1,
    cache: Path = CACHE,
) -> list[Trial]:
    """Run what the cache lacks and score it: every system over every drive, in this order.

    A system that is not installed is not run.
    """
    missing = {x: _not_installed(variants[0]) for x, variants in systems.items()}
    tasks = [
        Task(
            "run", f"{drive.name}, {variant.label}", _trial,
            (drive, name, variant, missing[name], cache),
        )
        for drive in drives
        for name, variants in systems.items()
        for variant in (variants[:1] if missing[name] else variants)
    ]  # fmt: skip
    with using(Workers(jobs, pinned=True)):
        return compute(tasks, progress)


def _not_installed(variant: Variant) -> str:
    if variant.estimator not in SYSTEMS:
        return ""
    try:
        python_of(variant.estimator)
    except DriftyardError as error:
        return str(error)
    return ""


def _trial(drive: Drive, name: str, variant: Variant, missing: str, cache: Path) -> Trial:
    if missing:
        return Trial(drive.name, drive.scene, name, None, None, missing)
    try:
        file = cached_run(drive.dataset, variant, cache, condition=ONE_CORE)
    except DriftyardError as error:
        return Trial(drive.name, drive.scene, name, None, None, str(error))
    result = Result(Job(Recording(drive.scene, drive.seed), variant), drive.dataset, file)
    lost_percent = 100 * result.lost_share
    problem = "" if result.score else "fewer than two frames have a pose"
    return Trial(drive.name, drive.scene, name, result.score, lost_percent, problem)


def parse_added(texts: Sequence[str]) -> dict[str, Path]:
    """Parse `NAME=FOLDER` of trajectory files of programs that were run elsewhere.

    Raises:
        SettingsError: If a text has another form, a name occurs twice or the folder is missing.
    """
    added: dict[str, Path] = {}
    for text in texts:
        name, _, folder = text.partition("=")
        if not name or not folder:
            raise SettingsError(f"--add {text}: expected NAME=FOLDER")
        if name in added:
            raise SettingsError(f"--add {text}: the name {name} occurs twice")
        if not Path(folder).is_dir():
            raise SettingsError(f"--add {text}: no such folder {folder}")
        added[name] = Path(folder)
    return added


def read_added(name: str, folder: Path, drives: Sequence[Drive]) -> Iterator[Trial]:
    """Score the trajectory files of a program: `DRIVE.txt`, and `DRIVE.2.txt` of further runs.

    Raises:
        SettingsError: If the folder has a file for none of the drives.
    """
    pattern = re.compile(r"(.+?)(\.\d+)?\.(txt|csv|tum)")
    files = {x: y[1] for x in sorted(folder.iterdir()) if (y := pattern.fullmatch(x.name))}
    names = [drive.name for drive in drives]
    if not set(names) & set(files.values()):
        raise SettingsError(
            f"--add {name}={folder}: has no trajectory of a drive; expected {names[0]}.txt, ..."
        )
    for drive in drives:
        own = [file for file, of in files.items() if of == drive.name]
        if not own:
            problem = f"{folder} has no {drive.name}.txt"
            yield Trial(drive.name, drive.scene, name, None, None, problem)
        for file in own:
            yield _read(name, file, drive)


def _read(name: str, file: Path, drive: Drive) -> Trial:
    times_ns = read_frame_times(drive.dataset)
    try:
        run = read_run(file, times_ns)
        (score,) = score_runs(drive.dataset, [run])
    except DriftyardError as error:
        remark(f"{file}: is not compared ({error})")
        return Trial(drive.name, drive.scene, name, None, None, str(error))
    return Trial(drive.name, drive.scene, name, score, _lost_percent(run, times_ns))


def _lost_percent(run: SavedRun, times_ns: Indices) -> float:
    known = run.trajectory.timestamps_ns
    nearest = known[np.searchsorted((known[1:] + known[:-1]) // 2, times_ns)]
    has_pose = np.abs(nearest - times_ns) < SAME_TIME_NS
    return float(100 * np.mean(~has_pose & ~between_keyframes(times_ns, has_pose)))
