"""Time of a recorded frame by camera: the cameras record the same drive in turn, several times."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from rich.table import Table

from sim.batch import build
from sim.camera_names import DEFAULT_CAMERA, IDEAL
from sim.record import record
from trials.execution.progress import ProgressBar, no_progress
from trials.execution.recording_settings import recording_settings
from trials.report.tables import text_table
from trials.studies.speed.drive import on_cores
from vo.contract.arrays import Array

CAMERAS = (IDEAL, DEFAULT_CAMERA)
ROUNDS, QUICK_ROUNDS = 5, 3
DRIVE = ("drive.distance_m=1.2",)
FIRST = 5
"""Frame from which times count: the first ones upload textures and compile."""
RATIO_MAX = "≤ 1.10"


def measure_cameras(
    scene: str,
    seed: int,
    rounds: int,
    bar: ProgressBar = no_progress,
    drive: Sequence[str] = DRIVE,
) -> Array:
    """Record a drive by each of CAMERAS in every round.

    Returns:
        (rounds, cameras, 2) milliseconds a frame of the clock and of all threads' processor time.
    """
    chosen = [recording_settings(scene, seed, drive, camera=x) for x in CAMERAS]
    found = np.empty((rounds, len(chosen), 2))
    with tempfile.TemporaryDirectory() as folder, bar("cameras") as progress:
        for k, settings in enumerate(chosen * rounds):
            times: list[tuple[float, float]] = []
            record(
                build(scene, settings), settings, Path(folder) / "drive", overwrite=True,
                progress=lambda done, total, x=times: x.append((perf_counter(), process_time())),
            )  # fmt: skip
            spent_s = np.diff(times[FIRST:], axis=0).mean(axis=0)
            found[divmod(k, len(chosen))] = 1e3 * spent_s
            progress(k + 1, found.shape[0] * found.shape[1])
    return found


def camera_table(
    scene: str, seed: int, quick: bool, cores: list[int], bar: ProgressBar = no_progress
) -> Table:
    """Tabulate the medians over rounds, and those of the ratios to the first camera in a round."""
    rounds = QUICK_ROUNDS if quick else ROUNDS
    measured = on_cores(cores, measure_cameras, scene, seed, rounds, bar)
    ratios = np.median(measured / measured[:, :1], axis=0)
    rows: list[Sequence[str]] = []
    for name, (wall_ms, cpu_ms), (wall, cpu) in zip(
        CAMERAS, np.median(measured, axis=0), ratios, strict=True
    ):
        limit = RATIO_MAX if rows else ""
        rows.append((name, f"{wall_ms:.1f}", f"{cpu_ms:.1f}", f"{wall:.3f}", f"{cpu:.3f}", limit))
    heads = "ms of clock", "ms of processor", "ratio, clock", "ratio, processor", "required"
    return text_table((f"{scene}, a frame, {rounds} rounds", *heads), rows)
