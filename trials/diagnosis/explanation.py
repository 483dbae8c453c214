"""Explanation of the drift on a scene: attribution, bound and consistency of the same runs.

The attribution is validated by injected errors: `driftyard explain --validate`.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trials.diagnosis.attribution import Attribution, Coalition, attribute
from trials.diagnosis.bound import Bound, bound
from trials.diagnosis.combinations import (
    BIRTHS,
    RUN,
    STAGES,
    OracleJob,
    RunDrift,
    Subject,
    combinations_of,
    paired,
    run_all,
)
from trials.diagnosis.hooks import InjectedError
from trials.evaluation.consistency import Nees, nees, summarize
from trials.evaluation.runs import read_run
from trials.evaluation.truth import true_trajectory
from trials.execution.store import present
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError, TrajectoryError
from vo.runner import companion

CASES = {
    "1 px noise on matches": (InjectedError(pixel_sigma_px=1.0), "matching"),
    "baseline 1 % too long": (InjectedError(baseline_percent=1.0), "stereo"),
    "disparities 0.5 px too large": (InjectedError(disparity_bias_px=0.5), "stereo"),
}
"""Description to the injected error and the stage in which it is."""
MIN_ATTRIBUTED = 0.8
"""Smallest ratio of the added drift that must be attributed to that stage."""


@dataclass(frozen=True)
class Explanation:
    """Results for one scene, or for one set of datasets.

    Attributes:
        name: Of the scene.
        datasets: Names.
        separated: Stages that were replaced.
        inseparable: Requested stages that the estimator does not allow to replace.
        attribution: None if no stage could be replaced.
        drift: Drift of each dataset without oracles, %.
        lost: Number of frames without a pose, over all combinations.
        bounds: One for each dataset, or the reason why there is none.
        nees: One for each dataset; empty if the estimator gives no covariances.
        subject: Estimator that was run.
        settings: Its resolved settings.
    """

    name: str
    datasets: tuple[str, ...]
    separated: tuple[str, ...]
    inseparable: tuple[str, ...]
    attribution: Attribution | None
    drift: tuple[float, ...]
    lost: int
    bounds: tuple[Bound | str, ...]
    nees: tuple[Nees, ...]
    subject: Subject
    settings: Mapping[str, Any]

    @property
    def bounded(self) -> list[Bound]:
        """Bounds of the datasets that have one."""
        return [x for x in self.bounds if isinstance(x, Bound)]

    def pooled(self, kind: str) -> Array:
        """Concatenate the NEES of all datasets: `absolute`, `step` or `over_1m`."""
        return np.concatenate([getattr(x, kind) for x in self.nees] or [np.zeros(0)])

    def as_json(self) -> dict[str, Any]:
        """Return numbers, strings and None, without the curves along the path."""
        return {
            "name": self.name,
            "estimator": self.subject.estimator.name,
            "settings": self.settings,
            "oracle_noise_px": self.subject.noise_px,
            "datasets": self.datasets,
            "separated": self.separated,
            "inseparable": self.inseparable,
            "drift_percent": asdict(self.attribution.drift) if self.attribution else None,
            "shares": [asdict(x) for x in self.attribution.shares] if self.attribution else [],
            "drift_by_dataset_percent": self.drift,
            "frames_lost": self.lost,
            "bounds": [x if isinstance(x, str) else asdict(x) for x in self.bounds],
            "consistency": [asdict(x) for x in summarize(self.nees)],
        }


def explain(
    groups: Mapping[str, Sequence[Path]],
    subject: Subject,
    stages: Sequence[str],
    cache: Path,
    progress: Callable[[int, int], None],
) -> list[Explanation]:
    """Run every combination of oracles over every dataset, and evaluate the runs by group.

    `progress` takes the number of finished runs and of all runs.

    Raises:
        DriftyardError: If a dataset has no labels, or no segment has a pose in all combinations.
    """
    datasets = [x for some in groups.values() for x in some]
    plain = [job for x in datasets for job in combinations_of(x, subject, (), cache).values()]
    combinations = len(datasets) * 2 ** len(stages)
    found = run_all(plain, lambda done: progress(done, combinations))
    queried = {x for drift in found.values() for x in drift.queried}
    separated = [x for x in stages if set(STAGES[x]) <= queried]
    jobs = {x: combinations_of(x, subject, separated, cache) for x in datasets}
    every = [job for some in jobs.values() for job in some.values()]
    found = run_all(every, lambda done: progress(done, len(every)))
    return [
        _explanation(name, subject, {x: jobs[x] for x in some}, found, separated, stages)
        for name, some in groups.items()
    ]


def _explanation(
    name: str,
    subject: Subject,
    jobs: Mapping[Path, Mapping[Coalition, OracleJob]],
    found: Mapping[OracleJob, RunDrift],
    separated: Sequence[str],
    stages: Sequence[str],
) -> Explanation:
    drifts = {x: {c: found[job] for c, job in some.items()} for x, some in jobs.items()}
    attribution = None
    if separated:
        attribution = attribute([paired(str(x), some) for x, some in drifts.items()], separated)
    bounds: list[Bound | str] = []
    consistency: list[Nees] = []
    settings: Mapping[str, Any] = {}
    for dataset, some in jobs.items():
        folder = some[frozenset()].folder
        run = read_run(present(folder / RUN))
        settings = json.loads(companion(folder / RUN, "run.json").read_text("utf-8"))["settings"]
        try:
            bounds.append(bound(dataset, run, present(folder / BIRTHS)))
        except DriftyardError as error:
            bounds.append(str(error))
        with suppress(TrajectoryError):  # the estimator gives no covariances
            consistency.append(nees(true_trajectory(dataset), run))
    return Explanation(
        name,
        tuple(dataset.name for dataset in drifts),
        tuple(separated),
        tuple(x for x in stages if x not in separated),
        attribution,
        tuple(float(np.mean(some[frozenset()].percent)) for some in drifts.values()),
        sum(x.lost for some in drifts.values() for x in some.values()),
        tuple(bounds),
        tuple(consistency),
        subject,
        settings,
    )


@dataclass(frozen=True)
class Finding:
    """Attribution before and after the error of a case is injected into a stage."""

    name: str
    stage: str
    before: Attribution
    after: Attribution

    @property
    def attributed(self) -> float:
        """Ratio of the added drift that is attributed to the stage with the error."""
        was, now = (
            next(x.drift.value for x in attribution.shares if x.stage == self.stage)
            for attribution in (self.before, self.after)
        )
        return (now - was) / (self.after.drift.value - self.before.drift.value)


def validate(
    datasets: Sequence[Path], subject: Subject, stages: Sequence[str], cache: Path,
    progress: Callable[[int, int], None],
) -> list[Finding]:  # fmt: skip
    """Attribute the drift with and without each injected error.

    Stages include `matching` and `stereo`; `progress` takes the number of finished runs and of all.
    """
    subjects = [subject, *(replace(subject, error=x) for x, _ in CASES.values())]
    jobs = {(s, d): combinations_of(d, s, stages, cache) for s in subjects for d in datasets}
    every = [job for some in jobs.values() for job in some.values()]
    found = run_all(every, lambda done: progress(done, len(every)))
    before, *after = (
        attribute(
            [paired(str(d), {c: found[x] for c, x in jobs[s, d].items()}) for d in datasets], stages
        )
        for s in subjects
    )
    return [
        Finding(name, stage, before, with_error)
        for (name, (_, stage)), with_error in zip(CASES.items(), after, strict=True)
    ]
