"""Explanation of the drift on a scene: attribution, bound and consistency of the same runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trials.diagnosis.attribution import Attribution, Coalition, attribute
from trials.diagnosis.bound import Bound, bound
from trials.diagnosis.combinations import (
    BIRTHS,
    RUN,
    STAGES,
    RunDrift,
    Subject,
    combinations_of,
    paired,
    run_all,
    run_folder,
)
from trials.evaluation.consistency import Nees, nees, summarize
from trials.evaluation.runs import SavedRun, read_run
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError, TrajectoryError
from vo.contract.readers import read_truth


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
            "datasets": self.datasets,
            "separated": self.separated,
            "inseparable": self.inseparable,
            "drift_percent": asdict(self.attribution.drift) if self.attribution else None,
            "shares": [asdict(x) for x in self.attribution.shares] if self.attribution else [],
            "drift_by_dataset_percent": self.drift,
            "frames_lost": self.lost,
            "bounds": [x if isinstance(x, str) else _plain(x) for x in self.bounds],
            "consistency": [asdict(x) for x in summarize(self.nees)],
        }


def explain(
    groups: Mapping[str, Sequence[Path]],
    subject: Subject,
    stages: Sequence[str],
    cache: Path,
    progress: Callable[[int, int], None],
) -> list[Explanation]:
    """Run every combination of oracles over every dataset, and evaluate the runs.

    Args:
        groups: Name to the datasets that are explained together.
        subject: Estimator that is examined.
        stages: Keys of STAGES.
        cache: Folder of the cache.
        progress: Called with the number of finished runs and of all runs.

    Raises:
        DriftyardError: If a dataset has no labels, or no segment has a pose in all combinations.
    """
    datasets = [x for some in groups.values() for x in some]
    every = len(datasets) * 2 ** len(stages)
    plain = [job for x in datasets for job in combinations_of(x, subject, (), cache).values()]
    queried: set[str] = set()
    for done, (_, drift) in enumerate(run_all(plain), 1):
        queried.update(drift.queried)
        progress(done, every)
    separated = [x for x in stages if set(STAGES[x]) <= queried]
    jobs = {x: combinations_of(x, subject, separated, cache) for x in datasets}
    owner = {job: (x, c) for x in datasets for c, job in jobs[x].items()}
    found: dict[Path, dict[Coalition, RunDrift]] = {x: {} for x in datasets}
    for done, (job, drift) in enumerate(run_all(list(owner)), 1):
        dataset, coalition = owner[job]
        found[dataset][coalition] = drift
        progress(done, len(owner))
    return [
        _explanation(name, {x: (run_folder(x, subject, cache), found[x]) for x in some},
                     separated, stages)
        for name, some in groups.items()
    ]  # fmt: skip


def _explanation(
    name: str,
    parts: Mapping[Path, tuple[Path, Mapping[Coalition, RunDrift]]],
    separated: Sequence[str],
    stages: Sequence[str],
) -> Explanation:
    runs = [(dataset, folder, read_run(folder / RUN)) for dataset, (folder, _) in parts.items()]
    attribution = None
    if separated:
        attribution = attribute([paired(str(x), y) for x, (_, y) in parts.items()], separated)
    return Explanation(
        name,
        tuple(dataset.name for dataset in parts),
        tuple(separated),
        tuple(x for x in stages if x not in separated),
        attribution,
        tuple(float(np.mean(found[frozenset()].percent)) for _, found in parts.values()),
        sum(x.lost for _, found in parts.values() for x in found.values()),
        tuple(_bound(dataset, run, folder / BIRTHS) for dataset, folder, run in runs),
        tuple(x for dataset, _, run in runs if (x := _nees(dataset, run))),
    )


def _bound(dataset: Path, run: SavedRun, births: Path) -> Bound | str:
    try:
        return bound(dataset, run, births)
    except DriftyardError as error:
        return str(error)


def _nees(dataset: Path, run: SavedRun) -> Nees | None:
    truth = read_truth(dataset)
    try:
        return nees(truth, run) if truth else None
    except TrajectoryError:  # the estimator gives no covariances
        return None


def _plain(x: Bound) -> dict[str, Any]:
    return {
        "over_1m_percent": x.over_1m_percent,
        "bound_over_1m_percent": x.bound_over_1m_percent,
        "end_m": x.end_m,
        "bound_end_m": x.bound_end_m,
        "noise_px": x.noise.effective_px.tolist(),
        "bias_px": x.noise.bias_px.tolist(),
        "observations": x.observations,
    }
