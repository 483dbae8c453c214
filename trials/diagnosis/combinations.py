"""Runs of an estimator with the truth in the place of every combination of its stages.

Each run is kept under a folder named after all that decides it, so that a study goes on where it
was interrupted and a second one is free.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from trials.diagnosis.attribution import Coalition, Sequence1m, coalitions
from trials.diagnosis.error_injection import Injection
from trials.estimators.choice import ESTIMATORS, Named
from trials.execution.cache import cache_path, dataset_digest, source_digest
from trials.execution.parallel import map_parallel
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DatasetError

PLAYERS = {
    "prediction": ("prediction",),
    "matching": ("matches", "features"),
    "matches": ("matches",),
    "features": ("features",),
    "stereo": ("stereo",),
    "inliers": ("inliers",),
}
"""What can be blamed, and the oracles that take its place."""
USUAL = ("prediction", "matching", "stereo", "inliers")
SOURCES = (
    "vo",
    "trials/diagnosis/oracles.py",
    "trials/evaluation/truth.py",
    "trials/diagnosis/error_injection.py",
)
RUN = "run.txt"
"""Trajectory of a run without any oracle, with all its companions."""
BORN = "born.npz"


@dataclass(frozen=True)
class Subject:
    """What is examined.

    Attributes:
        estimator: One of ours, or a class that takes hooks.
        noise_px: Of the oracles.
        injection: What is done wrong on purpose.
    """

    estimator: Named = field(default_factory=Named)
    noise_px: float = 0.0
    injection: Injection = field(default_factory=Injection)


@dataclass(frozen=True)
class Drift:
    """What one run came to.

    Attributes:
        start_ns: (K,) first times of segments of 1 m.
        at_m: (K,) true path before them.
        percent: (K,) their drift.
        lost: Frames without a pose.
        asked: Stages for which the estimator asked its hooks.
    """

    start_ns: Indices
    at_m: Array
    percent: Array
    lost: int
    asked: tuple[str, ...]


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        dataset: With depth labels.
        subject: What runs.
        oracles: Stages that are true.
        folder: Where runs of this subject on this dataset are kept.
    """

    dataset: Path
    subject: Subject
    oracles: Coalition
    folder: Path

    @property
    def file(self) -> Path:
        """What is kept of this run."""
        return self.folder / f"{'+'.join(sorted(self.oracles)) or 'none'}.npz"


def drifts(jobs: Sequence[Job]) -> Iterator[tuple[Job, Drift]]:
    """Run what has not been run, on all cores; yields as they finish."""
    missing = [job for job in jobs if not job.file.is_file()]
    for job in jobs:
        if job not in missing:
            yield job, _load(job.file)
    if not missing:
        return
    for k, drift in map_parallel(_run, [(job,) for job in missing]):
        yield missing[k], drift


def paired(name: str, found: dict[Coalition, Drift]) -> Sequence1m:
    """Keep the segments that every combination of oracles has.

    Raises:
        DatasetError: If there is none.
    """
    common = reduce(np.intersect1d, [x.start_ns for x in found.values()])
    if len(common) == 0:
        lost = {"+".join(sorted(c)) or "none": x.lost for c, x in found.items() if x.lost}
        raise DatasetError(f"{name}: no metre that all combinations have; frames lost: {lost}")
    rows = {c: np.searchsorted(x.start_ns, common) for c, x in found.items()}
    at_m = found[frozenset()].at_m[rows[frozenset()]]
    return Sequence1m(name, at_m, {c: x.percent[rows[c]] for c, x in found.items()})


def jobs_for(
    dataset: Path, subject: Subject, players: Sequence[str], folder: Path
) -> dict[Coalition, Job]:
    """One job for every combination of players."""
    return {c: Job(dataset, subject, _oracles(c), folder) for c in coalitions(players)}


def run_folder(dataset: Path, subject: Subject, cache: Path) -> Path:
    """Folder named after all that decides the runs of a subject on a dataset.

    Raises:
        DatasetError: If the dataset is none of ours.
    """
    manifest = dataset / MANIFEST
    if not manifest.is_file():
        raise DatasetError(f"{dataset}: no {MANIFEST}: oracles need a simulated dataset")
    name, config = subject.estimator.name, subject.estimator.config
    plugin = "" if name in ESTIMATORS else name.partition(":")[0]
    file = config.read_text(encoding="utf-8") if config else ""
    causes = (dataset_digest(dataset), repr(asdict(subject)), file, source_digest(SOURCES, plugin))
    return cache_path(cache, "explanations", dataset.name, *causes)


def _oracles(players: Coalition) -> Coalition:
    return frozenset(oracle for x in players for oracle in PLAYERS[x])


def _run(job: Job) -> Drift:
    import cv2

    from trials.diagnosis.bound import write_births
    from trials.diagnosis.error_injection import Injected
    from trials.diagnosis.oracles import Oracle
    from trials.estimators.choice import make_estimator
    from trials.estimators.plugins.guard import Guarded
    from trials.evaluation.alignment import associate
    from trials.evaluation.metrics import errors_over_distance
    from vo.contract.readers import open_sequence, read_truth
    from vo.runner import run, write_run

    cv2.setNumThreads(1)
    sequence, truth = open_sequence(job.dataset), read_truth(job.dataset)
    if truth is None:
        raise DatasetError(f"{job.dataset}: holds no truth to compare with")
    choice, injection = job.subject.estimator, job.subject.injection
    rig = injection.rig(sequence.rig)
    made, settings = make_estimator(choice.name, rig, choice.config, choice.overrides)
    estimator: Any = made
    oracle = Oracle(job.dataset, job.oracles, job.subject.noise_px, rig=rig)
    if hasattr(estimator, "hooks"):
        estimator.hooks = oracle if injection == Injection() else Injected(injection, oracle)
    result = run(sequence, estimator if choice.name in ESTIMATORS else Guarded(estimator))
    job.folder.mkdir(parents=True, exist_ok=True)
    if not job.oracles:
        write_run(job.folder / RUN, result, choice.name, settings, job.dataset)
        write_births(job.folder / BORN, oracle.births)
    lost = len(sequence) - len(result.trajectory)
    nothing = np.zeros(0)
    drift = Drift(nothing.astype(np.int64), nothing, nothing, lost, tuple(sorted(oracle.asked)))
    if len(result.trajectory) > 1:
        pair = associate(truth, result.trajectory)
        errors = errors_over_distance(pair, 1.0)
        drift = Drift(
            pair.timestamps_ns[errors.start],
            pair.travelled_m[errors.start],
            100 * errors.translation_m / errors.length_m,
            lost,
            drift.asked,
        )
    _save(job.file, drift)
    return drift


def _save(path: Path, drift: Drift) -> None:
    from vo.contract.files import replacing

    with replacing(path) as partial, partial.open("wb") as file:
        about = json.dumps({"lost": drift.lost, "asked": drift.asked})
        np.savez(file, start_ns=drift.start_ns, at_m=drift.at_m, percent=drift.percent, about=about)


def _load(path: Path) -> Drift:
    with np.load(path) as file:
        about = json.loads(str(file["about"]))
        return Drift(
            file["start_ns"], file["at_m"], file["percent"], about["lost"], tuple(about["asked"])
        )
