"""Time of a frame by the estimator over that of the baseline, on recordings made for it.

Both run on one core, in one process, in turn: the load of the machine is that of both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from sim.batch import build
from sim.camera_names import DEFAULT_CAMERA
from sim.record import record
from trials.estimators.choice import COMPARED
from trials.execution.progress import ProgressBar, no_progress
from trials.execution.recording_settings import recording_settings
from trials.report.tables import text_table
from trials.studies.speed.estimator import EstimatorSpeed, measure_estimator

ROUNDS = 4
"""Runs of each estimator over a recording, alternately."""
TAIL = 0.95


@dataclass(frozen=True)
class TimedRecording:
    """A recording by the default camera, its settings, and the required ratio of frame times."""

    scene: str
    overrides: tuple[str, ...]
    required: str

    def write(self, seed: int, distance_m: float, out: Path) -> None:
        """Record it as the dataset `out`; its own settings, a length among them, come first."""
        overrides = [f"drive.distance_m={distance_m}", *self.overrides]
        settings = recording_settings(self.scene, seed, overrides, camera=DEFAULT_CAMERA)
        record(build(self.scene, settings), settings, out)


SMALL = ("rig.width_px=320", "rig.height_px=240", "rig.rate_hz=10", "drive.speed_mps=0.5")
"""Settings of the gate's drives, `tests/gate/baseline.json`."""

RECORDINGS: Mapping[str, TimedRecording] = {
    "brick_court, 640 × 480": TimedRecording("brick_court", (), "≤ 0.45"),
    "hand-held, noise of 2 grey levels": TimedRecording(
        "brick_court", ("drive.carrier=handheld", "sensor.read_noise=70"), "≤ 0.45"
    ),
    "320 × 240, 10 Hz, 0.5 m/s": TimedRecording("brick_court", SMALL, "≤ 1"),
    **{
        f"gate drive, {scene}": TimedRecording(scene, (*SMALL, "drive.distance_m=1.5"), "≤ 1")
        for scene in ("corridor", "lab_circle")
    },
}
MAX_TAIL = "≤ 1.6"
"""Required ratio of the 95th percentile to the median."""


def measure_rounds(
    dataset: Path, rounds: int = ROUNDS, bar: ProgressBar = no_progress
) -> dict[str, list[EstimatorSpeed]]:
    """Run the estimators over a dataset in turn, so many times each."""
    speeds: dict[str, list[EstimatorSpeed]] = {name: [] for name in COMPARED}
    for _ in range(rounds):
        for name, measured in speeds.items():
            measured.append(measure_estimator(name, dataset, bar))
    return speeds


def comparison_table(measured: Mapping[str, Mapping[str, list[EstimatorSpeed]]]) -> Table:
    """Tabulate medians over the rounds, with a row for each recording of RECORDINGS."""
    rows: list[tuple[str, ...]] = []
    for label, speeds in measured.items():
        ours, theirs = (np.array([x.frame_ms for x in speeds[name]]) for name in COMPARED)
        median, mean = (
            np.median(statistic(ours, axis=1) / statistic(theirs, axis=1))
            for statistic in (np.median, np.mean)
        )
        tail = np.median(np.quantile(ours, TAIL, axis=1) / np.median(ours, axis=1))
        ours_ms, theirs_ms = (np.median(np.median(x, axis=1)) for x in (ours, theirs))
        required = RECORDINGS[label].required
        cells = f"{ours_ms:.1f}", f"{theirs_ms:.1f}", f"{median:.2f}", f"{mean:.2f}", required
        rows.append((label, *cells, f"{tail:.2f}", MAX_TAIL))
    header = (
        f"1 core, in turn; camera {DEFAULT_CAMERA}",
        "ms, median",
        "corner_flow",
        "ratio, median",
        "mean",
        "required",
    )
    return text_table((*header, "95th percentile over median", "required"), rows)
