"""Trajectory files of any format that estimators write."""

from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory
from vo.recordings.pose_tables import (
    TUM,
    matrix_columns,
    matrix_poses,
    named_columns,
    unnamed_columns,
)
from vo.recordings.tables import MIN_STEP_NS, NS, SECONDS, Table, median_step, read_table

FORMATS = (
    "'timestamp tx ty tz qx qy qz qw' (TUM), 'timestamp, px, py, pz, qw, qx, qy, qz' (EuRoC), or "
    "12 numbers (KITTI)"
)
SAME_TIME_NS = 1_000_000
"""A pose belongs to a frame if their times differ by less than this."""


def read_trajectory(path: Path, frame_times_ns: Indices | None = None) -> Trajectory:
    """Read poses of a frame in a fixed one: TUM, a EuRoC table, or KITTI's rows.

    A header that names columns decides which is which, further columns are ignored. Timestamps are
    seconds or nanoseconds, by which fits the recording.

    Args:
        path: The file.
        frame_times_ns: (N,) times of the recording's frames; KITTI's rows have no others. Without
            them, times are in seconds, or in nanoseconds if they are 100,000 apart.

    Raises:
        TrajectoryError: If the file is missing or a row malformed; names file and line.
    """
    table = read_table(path, TrajectoryError)
    if not len(table):
        raise TrajectoryError(f"{path}: holds no poses; expected rows of {FORMATS}")
    named = named_columns(table)
    columns = matrix_columns(table) if named is None else None
    if columns in (12, 16):
        return _at_frames(table, matrix_poses(table, columns), frame_times_ns)
    if named and named.quat_wxyz is None:
        raise TrajectoryError(f"{path}: its header names no quaternion; expected rows of {FORMATS}")
    stamps = table.stamps(named.time if named else 0, FORMATS)
    if frame_times_ns is not None and _are_counts(stamps, frame_times_ns):
        raise table.fault(0, f"the first column counts rows or frames; expected {FORMATS}")
    unit_ns = NS if (median_step(stamps) or 0) >= MIN_STEP_NS else SECONDS
    if frame_times_ns is not None:
        unit_ns = table.unit_ns(stamps, SECONDS, frame_times_ns)
    times_ns = table.in_ns(stamps, unit_ns)
    table.require_increasing(times_ns)
    if columns:
        T_ref_frame = matrix_poses(table, columns)
    else:
        T_ref_frame = (named or unnamed_columns(table, unit_ns, TUM)).poses(table, FORMATS)
    if frame_times_ns is not None:
        _remark_other_times(path, times_ns, frame_times_ns)
    return Trajectory(times_ns, T_ref_frame)


def _at_frames(table: Table, T_ref_frame: Array, frame_times_ns: Indices | None) -> Trajectory:
    if frame_times_ns is None or len(frame_times_ns) != len(T_ref_frame):
        frames = "no recording" if frame_times_ns is None else f"{len(frame_times_ns)} frames"
        rows = f"{len(T_ref_frame)} rows of a matrix, which have no times,"
        raise TrajectoryError(f"{table.path}: {rows} for {frames}")
    return Trajectory(frame_times_ns, T_ref_frame)


def _remark_other_times(path: Path, times_ns: Indices, frame_times_ns: Indices) -> None:
    """Issue a remark if most poses are beside the frames, unless they come at another rate."""
    within = times_ns[(times_ns >= frame_times_ns[0]) & (times_ns <= frame_times_ns[-1])]
    if len(within) < 2 or len(within) > 1.5 * len(frame_times_ns):
        return
    after = np.searchsorted(frame_times_ns, within)
    before_ns = within - frame_times_ns[np.maximum(after - 1, 0)]
    distance_ns = np.minimum(np.abs(frame_times_ns[after] - within), np.abs(before_ns))
    beside = distance_ns > SAME_TIME_NS
    if beside.sum() > len(within) / 2:
        remark(
            f"{path}: {beside.sum()} of {len(within)} poses are not at the time of a frame but up "
            f"to {distance_ns.max() / 1e6:.1f} ms beside; were times shifted or rounded?"
        )


def _are_counts(stamps: Sequence[Decimal], frame_times_ns: Indices) -> bool:
    """Whether timestamps are 0, 1, 2 …, or 1, 2, 3 …, or whole numbers below that of frames.

    They may be seconds if the frames are about a second apart.
    """
    if len(stamps) < 3 or len(frame_times_ns) < 2:
        return False
    is_consecutive = stamps[0] in (0, 1) and all(b - a == 1 for a, b in pairwise(stamps))
    is_index = all(x.as_tuple().exponent == 0 and 0 <= x < len(frame_times_ns) for x in stamps)
    period_s = float(np.median(np.diff(frame_times_ns))) / SECONDS
    return (is_consecutive or is_index) and not 0.9 < period_s < 1.1
