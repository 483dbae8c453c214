"""True trajectories as recordings have them: states, motion capture, or positions only."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory
from vo.recordings.calibration import read_sensor_pose
from vo.recordings.pose_tables import EUROC, named_columns, unnamed_columns
from vo.recordings.tables import NS, Table, read_table

STATE = "'timestamp [ns], px, py, pz, qw, qx, qy, qz', or without quaternions"


def read_true_states(
    tables: Sequence[Path], T_body_cam: Array, frame_times_ns: Indices | None = None
) -> Trajectory | None:
    """Read the first table that exists, as `read_true_poses`; None without one.

    A remark says so if it is not the first of all.
    """
    path = next(filter(Path.is_file, tables), None)
    if path is None:
        return None
    if path != tables[0]:
        remark(f"{path}: is taken as the truth, because there is no {tables[0].parent.name}")
    return read_true_poses(path, T_body_cam, frame_times_ns)


def read_true_poses(
    path: Path, T_body_cam: Array, frame_times_ns: Indices | None = None
) -> Trajectory:
    """Read a table of poses, or positions, of a sensor as T_world_cam of the left camera.

    The sensor's place in the body is `T_BS` of the sensor.yaml beside the table, by default the
    body's origin. Rows with NaN or a repetition of the row before are left out with a remark.

    Args:
        path: The table, quaternions scalar first unless named otherwise.
        T_body_cam: (4, 4) left camera in the body frame.
        frame_times_ns: (K,) times of the recording, which decide about the unit of time.

    Raises:
        TrajectoryError: If the table is missing or a row is malformed; names file and line.
        CalibrationError: If the sensor.yaml is malformed.
    """
    table = _complete_rows(read_table(path, TrajectoryError))
    if not len(table):
        raise TrajectoryError(f"{path}: holds no poses; expected rows of {STATE}")
    named = named_columns(table)
    stamps = table.stamps(named.time if named else 0, STATE)
    unit_ns = table.unit_ns(stamps, NS, frame_times_ns)
    unnamed = replace(EUROC, quat_wxyz=None) if len(table.rows[0]) < 8 else None
    columns = named or unnamed or unnamed_columns(table, unit_ns, EUROC)
    T_world_sensor, times_ns = columns.poses(table, STATE), table.in_ns(stamps, unit_ns)
    table.require_increasing(times_ns)
    sheet = path.with_name("sensor.yaml")
    T_body_sensor = read_sensor_pose(sheet) if sheet.is_file() else None
    if columns.quat_wxyz is not None:
        T_sensor_body = np.eye(4) if T_body_sensor is None else se3.inverse(T_body_sensor)
        return Trajectory(times_ns, T_world_sensor @ (T_sensor_body @ T_body_cam))
    origin_body = np.zeros(3) if T_body_sensor is None else T_body_sensor[:3, 3]
    where = "the body's origin" if T_body_sensor is None else "T_BS of sensor.yaml"
    what = "positions in a plane" if len(columns.position) == 2 else "positions"
    remark(f"{path}: has {what} only, of a point at {where}; errors are ATE without attitude")
    point_cam = se3.transform(se3.inverse(T_body_cam), origin_body[None])[0]
    return Trajectory(times_ns, T_world_sensor, point_cam)


def _complete_rows(table: Table) -> Table:
    """Leave out rows that hold NaN, or repeat the row before."""
    missing = {i for i, row in enumerate(table.rows) if any(x.lower() == "nan" for x in row)}
    repeated = {i for i in range(1, len(table)) if table.rows[i] == table.rows[i - 1]} - missing
    for rows, what in ((missing, "with NaN"), (repeated, "that repeat the row before")):
        if rows:
            places = f"{len(rows)}, the first in line {table.lines[min(rows)]}"
            remark(f"{table.path}: rows {what} are left out: {places}")
    kept = [i for i in range(len(table)) if i not in missing | repeated]
    lines, words = tuple(table.lines[i] for i in kept), tuple(table.rows[i] for i in kept)
    return replace(table, lines=lines, rows=words)
