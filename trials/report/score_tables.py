"""Tables of scores for pandas or DuckDB: one row for each segment, and one for each drive."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from trials.evaluation import metrics
from trials.evaluation.alignment import Pair, associate, gaps
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import Score
from trials.execution.jobs import Result
from trials.report.columns import columns_file
from vo.contract.arrays import Array
from vo.contract.errors import TrajectoryError
from vo.contract.trajectory import Trajectory

DRIVE = {"scene": str, "seed": int, "estimator": str}
SEGMENT = {"length_m": float, "start_ns": int, "x_m": float, "y_m": float, "z_m": float,
           "translation_m": float, "rotation_deg": float, "percent": float,
           "deg_per_m": float}  # fmt: skip
"""Columns of a segment: its length, time and true position at its start, and errors at its end."""
SCORES: dict[str, Callable[[Score], float | None]] = {
    "path_m": lambda x: x.path_m,
    "drift_1m_percent": lambda x: x.drift_pct,
    "drift_1m_deg_per_m": lambda x: x.drift_1m.mean_deg_per_m if x.drift_1m else None,
    "kitti_percent": lambda x: x.kitti_percent,
    "kitti_deg_per_m": lambda x: x.kitti_deg_per_m,
    "end_m": lambda x: x.end_m,
    "end_percent": lambda x: x.end_percent,
    **{
        f"ate_{fit}_m": lambda x, fit=fit: x.ate_m[fit].rmse if fit in x.ate_m else None
        for fit in ("first_pose", "se3", "sim3")
    },
    "frame_ms": lambda x: x.frame_ms,
}
"""Columns of the scores of a drive."""


@contextmanager
def segment_table(path: Path, key: dict[str, type]) -> Generator[Callable[..., None]]:
    """Yield a function that appends the segments of a run to a table.

    It takes the values of `key`, the true T_world_cam and the run. Segments of all lengths start at
    every frame (`metrics.errors_over_distance`); a run without two poses has none.

    Raises:
        SettingsError: As `columns_file`.
    """
    with columns_file(path, {**key, **SEGMENT}) as append:

        def add(values: dict[str, object], truth: Trajectory, run: SavedRun) -> None:
            try:
                pair = associate(truth, run.trajectory)
            except TrajectoryError:
                return
            parts = pair.split(gaps(truth)) if pair.has_attitude else []
            longest_m = max((float(x.travelled_m[-1]) for x in parts), default=0.0)
            found = [
                _segments(part, length_m)
                for length_m in dict.fromkeys((1.0, *metrics.segment_lengths_m(longest_m)))
                for part in parts
            ]
            if found:  # one group of rows for each run
                append({**values, **{x: np.concatenate([y[x] for y in found]) for x in SEGMENT}})

        yield add


def _segments(pair: Pair, length_m: float) -> dict[str, Array]:
    errors = metrics.errors_over_distance(pair, length_m)
    x_m, y_m, z_m = pair.T_world_cam[errors.start, :3, 3].T
    columns = (
        errors.length_m, pair.timestamps_ns[errors.start], x_m, y_m, z_m, errors.translation_m,
        np.degrees(errors.rotation_rad), errors.percent, errors.deg_per_m,
    )  # fmt: skip
    return dict(zip(SEGMENT, columns, strict=True))


def write_segments(path: Path, runs: Sequence[Result]) -> None:
    """Write the segments of runs over drives; SettingsError as `columns_file`."""
    with segment_table(path, DRIVE) as add:
        for x in runs:
            add(_drive(x), x.truth, x.run)


def write_drives(path: Path, runs: Sequence[Result]) -> None:
    """Write the scores of runs over drives, one row for each; SettingsError as `columns_file`."""
    schema = {**DRIVE, "frames": int, "lost_frames": int, **dict.fromkeys(SCORES, float)}
    rows = [
        {**_drive(x), "frames": len(x.frames), "lost_frames": x.lost_frames}
        | {name: figure(x.score) if x.score else None for name, figure in SCORES.items()}
        for x in runs
    ]
    with columns_file(path, schema) as append:
        append({name: [row[name] for row in rows] for name in schema})


def _drive(result: Result) -> dict[str, object]:
    job = result.job
    return dict(
        zip(DRIVE, (job.recording.scene, job.recording.seed, job.variant.label), strict=True)
    )
