"""Time of the bundle adjustment backends on the windows of a drive, and how far they differ."""

import os
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from rich.table import Table

from trials.report.tables import text_table
from trials.studies.speed.drive import on_cores
from vo.bundle_adjustment.adjust import BACKENDS, Refined, refine_structure
from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.bundle_adjustment.problem import Bundle, Optimum
from vo.config import THESIS, OdometrySettings, RefinementSettings
from vo.contract.arrays import Array
from vo.odometry import StereoOdometry
from vo.recordings.readers import open_sequence

PRESETS = {"driftyard": OdometrySettings(), "thesis": THESIS}
"""Estimators whose windows are measured."""

WINDOWS = 12
"""Number of windows of a drive that are measured."""


@dataclass(frozen=True)
class BackendSpeed:
    """Both backends on W windows.

    Attributes:
        measurements: (W,) in each window.
        ms: (W, 2) CPU time of "schur" and of "gtsam", covariances included.
        difference_m: (W,) largest distance of a camera from one solution to the other.
    """

    measurements: Array
    ms: Array
    difference_m: Array


def record_windows(dataset: Path, settings: OdometrySettings) -> list[Bundle]:
    """Run an estimator over a dataset and keep every window before its adjustment."""
    windows: list[Bundle] = []
    name = settings.refinement.backend
    optimize = BACKENDS[name]

    def record(
        bundle: Bundle, estimates: PointEstimates, settings: RefinementSettings, covariances: bool
    ) -> Optimum:
        windows.append(bundle)
        return optimize(bundle, estimates, settings, covariances)

    sequence = open_sequence(dataset)
    estimator = StereoOdometry(sequence.rig, settings)
    BACKENDS[name] = record
    try:
        for i in range(len(sequence)):
            estimator.track(sequence[i])
    finally:
        BACKENDS[name] = optimize
    return windows


def adjust(bundle: Bundle, settings: RefinementSettings, backend: str) -> Refined:
    """Adjust a bundle by one of the backends."""
    return refine_structure(bundle, settings.model_copy(update={"backend": backend}))


def measure_backends(dataset: Path, preset: str) -> BackendSpeed:
    """Measure both backends on windows of a preset of PRESETS."""
    settings = PRESETS[preset].refinement
    windows = record_windows(dataset, PRESETS[preset])
    windows = windows[:: max(1, len(windows) // WINDOWS)]
    for backend in ("schur", "gtsam"):  # the first call is slower
        adjust(windows[0], settings, backend)
    rows: list[tuple[float, ...]] = []
    for window in windows:
        found, ms = zip(*(_timed(window, settings, x) for x in ("schur", "gtsam")), strict=True)
        centres = [x.T_world_cam[:, :3, 3] for x in found]
        difference_m = np.linalg.norm(centres[0] - centres[1], axis=1).max()
        rows.append((len(window.measured), *ms, difference_m))
    table = np.array(rows)
    return BackendSpeed(table[:, 0], table[:, 1:3], table[:, 3])


def _timed(window: Bundle, settings: RefinementSettings, backend: str) -> tuple[Refined, float]:
    """Return the solution and the shorter of two CPU times, ms."""
    start = process_time()
    adjust(window, settings, backend)
    middle = process_time()
    found = adjust(window, settings, backend)
    return found, 1e3 * min(middle - start, process_time() - middle)


def measure_windows(dataset: Path) -> dict[str, BackendSpeed]:
    """Measure the backends over a dataset, on a single core, for each preset of PRESETS."""
    core = min(os.sched_getaffinity(0))
    return {x: on_cores([core], measure_backends, dataset, x) for x in PRESETS}


def backend_table(measured: dict[str, BackendSpeed]) -> Table:
    """Tabulate the time of a window by each backend, with a column for each estimator."""
    speeds = list(measured.values())
    rows = [
        ("windows", *(str(len(x.ms)) for x in speeds)),
        ("measurements, median", *(f"{np.median(x.measurements):.0f}" for x in speeds)),
    ]
    for k, name in enumerate(("schur", "gtsam")):
        rows.append((f"{name}, median, ms", *(f"{np.median(x.ms[:, k]):.1f}" for x in speeds)))
    for label, statistic in (("median", np.median), ("largest", np.max)):
        cells = (f"{1e3 * statistic(x.difference_m):.3f}" for x in speeds)
        rows.append((f"pose difference, {label}, mm", *cells))
    return text_table(("bundle adjustment, CPU, per window", *measured), rows)
