"""Why an estimator drifts on some scenes: attribution, bound and consistency of the same runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trials.diagnosis.attribution import Attribution, Coalition, attribute
from trials.diagnosis.bound import Bound, bound
from trials.diagnosis.combinations import (
    BORN,
    PLAYERS,
    RUN,
    Drift,
    Job,
    Subject,
    drifts,
    jobs_for,
    paired,
    run_folder,
)
from trials.evaluation.consistency import Nees, nees
from trials.evaluation.runs import SavedRun, read_run
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError, TrajectoryError
from vo.contract.readers import read_truth


@dataclass(frozen=True)
class Explanation:
    """What was found out on one scene, or on one set of datasets.

    Attributes:
        name: Of the scene.
        datasets: Names.
        separated: Stages that were replaced.
        inseparable: Stages that were asked for, and which the estimator does not let be replaced.
        attribution: None if nothing could be replaced.
        drift: Of each dataset without oracles, %.
        lost: Frames without a pose, of all combinations.
        bounds: One for each dataset, or why there is none.
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
        """NEES of all datasets: `absolute`, `step` or `over_1m`."""
        return np.concatenate([getattr(x, kind) for x in self.nees] or [np.zeros(0)])

    def as_json(self) -> dict[str, Any]:
        """Return plain numbers, strings and None; curves along the path are left out."""
        from trials.evaluation.consistency import summary

        return {
            "name": self.name,
            "datasets": self.datasets,
            "separated": self.separated,
            "inseparable": self.inseparable,
            "drift_percent": self.attribution.drift if self.attribution else None,
            "drift_interval": self.attribution.drift_interval if self.attribution else None,
            "shares": [asdict(x) for x in self.attribution.shares] if self.attribution else [],
            "drift_by_dataset_percent": self.drift,
            "frames_lost": self.lost,
            "bounds": [x if isinstance(x, str) else _plain(x) for x in self.bounds],
            "consistency": [asdict(x) for x in summary(self.nees)],
        }


def explain(
    groups: Mapping[str, Sequence[Path]],
    subject: Subject,
    players: Sequence[str],
    cache: Path,
    progress: Callable[[int, int], None],
) -> list[Explanation]:
    """Run every combination of oracles over every dataset.

    Args:
        groups: Name to the datasets that are explained together.
        subject: What is examined.
        players: Keys of PLAYERS.
        cache: Runs are kept here.
        progress: Called with the runs done and those in all.

    Raises:
        DriftyardError: If a dataset has no labels, or no metre survives all combinations.
    """
    datasets = [x for some in groups.values() for x in some]
    first = {x: Job(x, subject, frozenset(), run_folder(x, subject, cache)) for x in datasets}
    every = len(datasets) * 2 ** len(players)
    plain: dict[Path, Drift] = {}
    for done, (job, drift) in enumerate(drifts(list(first.values())), 1):
        plain[job.dataset] = drift
        progress(done, every)
    replaceable = {x for drift in plain.values() for x in drift.asked}
    separated = [x for x in players if set(PLAYERS[x]) <= replaceable]
    jobs = {x: jobs_for(x, subject, separated, first[x].folder) for x in datasets}
    owner = {job: (x, c) for x in datasets for c, job in jobs[x].items()}
    found: dict[Path, dict[Coalition, Drift]] = {x: {} for x in datasets}
    for done, (job, drift) in enumerate(drifts([j for x in datasets for j in jobs[x].values()]), 1):
        dataset, coalition = owner[job]
        found[dataset][coalition] = drift
        progress(done, len(owner))
    return [
        _explanation(name, [(x, first[x].folder, found[x]) for x in some], separated, players)
        for name, some in groups.items()
    ]


def _explanation(
    name: str,
    parts: Sequence[tuple[Path, Path, dict[Coalition, Drift]]],
    separated: Sequence[str],
    players: Sequence[str],
) -> Explanation:
    runs = [(dataset, folder, read_run(folder / RUN)) for dataset, folder, _ in parts]
    attribution = None
    if separated:
        attribution = attribute([paired(str(x), found) for x, _, found in parts], separated)
    return Explanation(
        name,
        tuple(dataset.name for dataset, _, _ in parts),
        tuple(separated),
        tuple(x for x in players if x not in separated),
        attribution,
        tuple(float(np.mean(found[frozenset()].percent)) for _, _, found in parts),
        sum(x.lost for _, _, found in parts for x in found.values()),
        tuple(_bound(dataset, run, folder / BORN) for dataset, folder, run in runs),
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
    except TrajectoryError:  # it gives no covariances: nothing to judge
        return None


def _plain(x: Bound) -> dict[str, Any]:
    return {
        "over_1m_percent": x.over_1m_percent,
        "least_over_1m_percent": x.least_over_1m_percent,
        "end_m": x.end_m,
        "least_end_m": x.least_end_m,
        "noise_px": x.noise.effective_px.tolist(),
        "bias_px": x.noise.bias_px.tolist(),
        "observations": x.observations,
    }
