"""Measurement of an estimator on the sequences of a gate; a failure is a lost sequence."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from trials.estimators.choice import Named, estimate, make_estimator
from trials.evaluation.consistency import DEGREES, nees
from trials.evaluation.runs import SavedRun, read_run
from trials.evaluation.score import score_run
from trials.evaluation.truth import true_trajectory
from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.store import present
from trials.execution.tasks import Task
from trials.gate.baseline import Measurement
from vo.contract.errors import DatasetError, DriftyardError, SettingsError, TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory
from vo.recordings.readers import open_sequence, recording_name

if TYPE_CHECKING:
    from trials.estimators.plugins.command import Command

MAX_LETTERS = 300
"""Longest error text of an estimator that is kept."""


class ReferenceTimer:
    """Frame times of the reference estimator, which runs after each frame of the candidate.

    Both thus meet the same load of the machine.
    """

    def __init__(self, reference: Named, dataset: Path) -> None:
        self._sequence = open_sequence(dataset)
        self._estimator, _ = make_estimator(
            reference.name, self._sequence.rig, reference.config, reference.overrides
        )
        self._frame_ms: list[float] = []

    def __call__(self, _: object = None) -> None:
        """Run the reference on the next frame and time it."""
        frame = self._sequence[len(self._frame_ms)]
        start = perf_counter()
        self._estimator.track(frame)
        self._frame_ms.append(1e3 * (perf_counter() - start))

    def median_ms(self) -> float:
        """Compute the median over all frames; frames that are left are run first."""
        while len(self._frame_ms) < len(self._sequence):
            self()
        return float(np.median(self._frame_ms))


def measure(
    choice: "Named | Command",
    reference: Named,
    datasets: Sequence[Path],
    runs: Sequence[Path],
    progress: Callable[[object], None],
) -> list[Measurement]:
    """Run an estimator over sequences, on all cores; write a trajectory file of each.

    The reference estimator, which normalizes frame times, runs after each frame, or, for a
    program, after the sequence.

    Raises:
        SettingsError: If an estimator does not exist or refuses a setting.
        DatasetError: If a dataset is damaged, or the estimator fails on every one.
    """
    tasks = [
        Task("run", recording_name(x), _measure, (choice, reference, x, out))
        for x, out in zip(datasets, runs, strict=True)
    ]
    is_class = isinstance(choice, Named) and choice.plugin is not None  # it may be of a notebook
    with using(Workers(0)) if is_class else nullcontext():
        found = compute(tasks, progress)
    if all(x.problem for x in found):
        first = recording_name(datasets[0])
        raise DatasetError(
            f"{choice.name} failed on every sequence; on {first}: {found[0].problem}"
        )
    return found


def _measure(choice: "Named | Command", reference: Named, dataset: Path, out: Path) -> Measurement:
    import cv2

    cv2.setNumThreads(1)
    frames = len(open_sequence(present(dataset)))
    timer = ReferenceTimer(reference, dataset)
    truth = true_trajectory(dataset)
    try:
        ran = estimate(choice, dataset, out, timer)
    except (DatasetError, SettingsError):
        raise
    except Exception as error:  # a plug-in may raise anything; the other sequences continue
        return Measurement(frames=frames, lost_frames=frames, problem=_described(error))
    measured = Measurement(
        frames=frames,
        lost_frames=sum(x.status is Status.LOST for x in ran.estimates),
        unclaimed_frames=frames - len(ran.estimates),
        frame_ms=float(np.median(ran.frame_ms)),
        reference_ms=timer.median_ms(),
    )
    try:
        saved = read_run(out)
        score = score_run(truth, saved, frames)
    except TrajectoryError:  # fewer than two poses: a lost sequence without errors
        return measured
    drift = score.drift_1m.mean_percent if score.drift_1m else None
    return measured.model_copy(update={"drift_percent": drift, "nees": _nees(truth, saved)})


def _described(error: Exception) -> str:
    """Describe an exception in one printable line."""
    words = " ".join(str(error).split())
    line = words if isinstance(error, DriftyardError) else f"{type(error).__name__}: {words}"
    return "".join(x if x.isprintable() else "?" for x in line)[:MAX_LETTERS]


def _nees(truth: Trajectory, saved: SavedRun) -> float | None:
    """Compute the median NEES of steps over the median of its distribution."""
    try:
        known = nees(truth, saved).step
    except TrajectoryError:
        return None
    known = known[np.isfinite(known) & (known > 0)]
    return float(np.median(known) / chi2.median(DEGREES)) if len(known) else None
