"""Runs of an estimator with every combination of oracles, kept in the cache."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import reduce
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trials.diagnosis.attribution import Coalition, SegmentDrifts, coalitions
from trials.diagnosis.bound import write_births
from trials.diagnosis.hooks import ErrorInjector, InjectedError, Oracle
from trials.estimators.choice import ESTIMATORS, Named, make_estimator
from trials.estimators.plugins.classes import Guarded
from trials.evaluation.alignment import associate
from trials.evaluation.metrics import errors_over_distance
from trials.evaluation.truth import true_trajectory
from trials.execution.cache import cache_path, dataset_digest, source_digest
from trials.execution.executor import compute
from trials.execution.store import present, publish
from trials.execution.tasks import Task
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.files import read_lines, replacing
from vo.recordings.readers import open_sequence
from vo.runner import run, write_run

STAGES = {
    "prediction": ("prediction",),
    "matching": ("matches", "features"),
    "matches": ("matches",),
    "features": ("features",),
    "stereo": ("stereo",),
    "inliers": ("inliers",),
}
"""Stages to which drift is attributed, and the oracles that replace each."""
SOURCES = ("vo", "trials/diagnosis", "trials/evaluation/truth.py")
"""Sources that decide a run, in addition to those of a plug-in."""
RUN = "run.txt"
"""Trajectory of a run without oracles, with its companion files."""
BIRTHS = "births.npz"
"""First observations of the landmarks of that run."""


@dataclass(frozen=True)
class Subject:
    """Estimator that is examined, std. dev. of the noise of its oracles, and injected error."""

    estimator: Named = field(default_factory=Named)
    noise_px: float = 0.0
    error: InjectedError = field(default_factory=InjectedError)


@dataclass(frozen=True)
class RunDrift:
    """Drift of one run.

    Attributes:
        start_ns: (K,) start times of segments of 1 m.
        at_m: (K,) true path before them.
        percent: (K,) their drift, %.
        lost: Number of frames without a pose.
        queried: Oracles for which the estimator called its hooks.
    """

    start_ns: Indices
    at_m: Array
    percent: Array
    lost: int
    queried: tuple[str, ...]


@dataclass(frozen=True)
class OracleJob:
    """One run of a subject with oracles on a dataset with depth labels, kept in `folder`."""

    dataset: Path
    subject: Subject
    oracles: Coalition
    folder: Path

    @property
    def file(self) -> Path:
        """File of the drift of this run."""
        return self.folder / f"{'+'.join(sorted(self.oracles)) or 'none'}.npz"


def run_all(
    jobs: Sequence[OracleJob], progress: Callable[[int], object]
) -> dict[OracleJob, RunDrift]:
    """Run jobs that are not in the cache, on all cores; `progress` takes the number of results."""
    found = {job: _load(job.file) for job in jobs if job.file.is_file()}
    missing = [job for job in jobs if job not in found]
    if found:
        progress(len(found))
    done = count(len(found) + 1)
    tasks = [Task("run", f"{x.dataset.name}, {x.file.stem}", _run, (x,)) for x in missing]
    drifts = compute(tasks, lambda _: progress(next(done)))
    return found | dict(zip(missing, drifts, strict=True))


def paired(name: str, found: Mapping[Coalition, RunDrift]) -> SegmentDrifts:
    """Keep the segments that the runs of all combinations have.

    Raises:
        DatasetError: If there is none.
    """
    common = reduce(np.intersect1d, [x.start_ns for x in found.values()])
    if len(common) == 0:
        lost = {"+".join(sorted(c)) or "none": x.lost for c, x in found.items() if x.lost}
        raise DatasetError(
            f"{name}: no segment of 1 m has a pose in all combinations; frames lost: {lost}"
        )
    rows = {c: np.searchsorted(x.start_ns, common) for c, x in found.items()}
    at_m = found[frozenset()].at_m[rows[frozenset()]]
    return SegmentDrifts(name, at_m, {c: x.percent[rows[c]] for c, x in found.items()})


def combinations_of(
    dataset: Path, subject: Subject, stages: Sequence[str], cache: Path
) -> dict[Coalition, OracleJob]:
    """Return a job for every combination of stages.

    Raises a DatasetError if the dataset was not simulated.
    """
    if not (dataset / MANIFEST).is_file():
        raise DatasetError(f"{dataset}: no {MANIFEST}; oracles need a simulated dataset")
    choice = subject.estimator
    module = "" if choice.name in ESTIMATORS else choice.name.partition(":")[0]
    config = "\n".join(read_lines(choice.config, SettingsError)) if choice.config else ""
    causes = (dataset_digest(dataset), source_digest(SOURCES, module), repr(asdict(subject)))
    folder = cache_path(cache, "oracles", dataset.name, *causes, config)
    return {
        c: OracleJob(dataset, subject, frozenset(x for stage in c for x in STAGES[stage]), folder)
        for c in coalitions(stages)
    }


def _run(job: OracleJob) -> RunDrift:
    cv2.setNumThreads(1)
    sequence, truth = open_sequence(present(job.dataset)), true_trajectory(job.dataset)
    choice, error = job.subject.estimator, job.subject.error
    rig = error.rig(sequence.rig)
    made, settings = make_estimator(choice.name, rig, choice.config, choice.overrides)
    estimator: Any = made
    oracle = Oracle(job.dataset, job.oracles, job.subject.noise_px, rig=rig)
    if hasattr(estimator, "hooks"):
        estimator.hooks = oracle if error == InjectedError() else ErrorInjector(error, oracle)
    result = run(sequence, estimator if choice.name in ESTIMATORS else Guarded(estimator))
    job.folder.mkdir(parents=True, exist_ok=True)
    if not job.oracles:
        write_run(job.folder / RUN, result, choice.name, settings, job.dataset)
        write_births(job.folder / BIRTHS, oracle.births)
        for name in (RUN, BIRTHS):
            publish(job.folder / name)
    lost, queried = len(sequence) - len(result.trajectory), tuple(sorted(oracle.queried))
    drift = RunDrift(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), lost, queried)
    if len(result.trajectory) > 1:
        pair = associate(truth, result.trajectory)
        errors = errors_over_distance(pair, 1.0)
        start_ns, at_m = pair.timestamps_ns[errors.start], pair.travelled_m[errors.start]
        drift = RunDrift(start_ns, at_m, errors.percent, lost, queried)
    with replacing(job.file) as partial, partial.open("wb") as file:
        np.savez(file, **vars(drift))
    return drift


def _load(path: Path) -> RunDrift:
    with np.load(path) as file:
        columns = (file["start_ns"], file["at_m"], file["percent"])
        return RunDrift(*columns, int(file["lost"]), tuple(file["queried"].tolist()))
