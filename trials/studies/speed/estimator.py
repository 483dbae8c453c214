"""Speed of an estimator; its process imports no simulator, as its memory is measured."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from trials.estimators.choice import make_estimator
from trials.execution.progress import ProgressBar, counted, no_progress
from vo.contract.arrays import Array
from vo.contract.estimator import Estimate
from vo.contract.sequence import StereoSequence
from vo.recordings.readers import open_sequence
from vo.runner import run

WARM_FRAMES = 12
"""Number of frames that are tracked before the timing, to exclude compilation."""


@dataclass(frozen=True)
class EstimatorSpeed:
    """Speed and memory of one estimator.

    Attributes:
        frame_ms: (frames,) wall time of each `track` call; without the loading of images.
        stage_ms: Stage to its mean over all frames.
        memory_mb: (frames,) resident memory of the process after each frame.
    """

    frame_ms: Array
    stage_ms: dict[str, float]
    memory_mb: Array


def measure_estimator(
    name: str, dataset: Path, bar: ProgressBar = no_progress, frames: int | None = None
) -> EstimatorSpeed:
    """Run an estimator over a dataset, warm; to and fro until it has tracked so many frames."""
    cv2.setNumThreads(1)
    sequence = open_sequence(dataset)
    if frames is not None:
        sequence = to_and_fro(sequence, frames)
    warm, _ = make_estimator(name, sequence.rig)
    for i in range(min(WARM_FRAMES, len(sequence))):
        warm.track(sequence[i])
    estimator, _ = make_estimator(name, sequence.rig)
    memory_mb: list[float] = []
    with counted(bar, f"running {name}", len(sequence)) as count:

        def note(estimate: Estimate, _: float) -> None:
            memory_mb.append(resident_mb())
            count(estimate)

        result = run(sequence, estimator, note)
    stages = dict.fromkeys(stage for x in result.estimates for stage in x.timings_ms)
    stage_ms = {
        stage: sum(x.timings_ms.get(stage, 0.0) for x in result.estimates) / len(sequence)
        for stage in stages
    }
    return EstimatorSpeed(np.array(result.frame_ms), stage_ms, np.array(memory_mb))


def to_and_fro(sequence: StereoSequence, frames: int) -> StereoSequence:
    """Repeat two frames or more backwards, forwards and so on, at even times."""
    last = len(sequence) - 1
    index = np.abs((np.arange(frames) + last) % (2 * last) - last)
    step_ns = int(np.median(np.diff(sequence.timestamps_ns)))
    times_ns = sequence.timestamps_ns[0] + step_ns * np.arange(frames)
    return replace(
        sequence, timestamps_ns=times_ns, load=lambda i: sequence.load(int(index[i])), wheels=None
    )


def resident_mb() -> float:
    """Memory of this process that is in RAM now, in MB of 2^20 bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
