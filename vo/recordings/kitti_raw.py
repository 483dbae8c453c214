"""Files of KITTI's raw recordings: dates, and poses from satellites and inertial unit (`oxts`)."""

import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.files import read_lines
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory
from vo.recordings.tables import read_table

EARTH_RADIUS_M = 6_378_137.0
SHEETS = ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")
ROW = "latitude, longitude, altitude, roll, pitch, yaw"


def read_dates(path: Path) -> Indices:
    """Read lines such as `2011-09-26 13:02:25.964389445` as ns since 1970.

    Raises:
        DatasetError: If the file is missing or malformed; names file and line.
    """
    times: list[int] = []
    for number, line in enumerate(read_lines(path), start=1):
        if text := line.strip():
            try:
                times.append(int(np.datetime64(text, "ns").astype(np.int64)))
            except ValueError:
                raise DatasetError(
                    f"{path}:{number}: expected a time such as 2011-09-26 13:02:25.964389445"
                ) from None
    return np.array(times, dtype=np.int64)


def read_oxts(folder: Path, T_cam0_left: Array) -> Trajectory | None:
    """Read the poses of the left camera from `oxts`; None without it or a calibration.

    The world is that of a Mercator projection at the first latitude, x to the east and z up.

    Raises:
        DriftyardError: If a file is malformed.

    Source:
        Geiger et al., Vision meets robotics: the KITTI dataset, IJRR 32(11), 2013, and its
        development kit.
    """
    files = sorted((folder / "oxts" / "data").glob("*.txt"))
    if not files:
        return None
    sheets = [next(filter(Path.is_file, (folder / x, folder.parent / x)), None) for x in SHEETS]
    cam, velo, imu = sheets
    if cam is None or velo is None or imu is None:
        remark(f"{folder / 'oxts'}: is no truth without {' and '.join(SHEETS)}")
        return None
    T_rectified_cam = se3.pose(read_matrix(cam, "R_rect_00", (3, 3)), np.zeros(3))
    T_cam_velo, T_velo_imu = (
        se3.pose(read_matrix(x, "R", (3, 3)), read_matrix(x, "T", (3,))) for x in (velo, imu)
    )
    rows = [read_table(x, TrajectoryError).numbers(range(6), ROW) for x in files]
    times = read_dates(folder / "oxts" / "timestamps.txt")
    if any(len(x) != 1 for x in rows) or len(rows) != len(times):
        raise TrajectoryError(f"{folder / 'oxts'}: {len(rows)} files for {len(times)} times")
    latitude, longitude, altitude, *angles = np.concatenate(rows).T
    latitude, longitude = np.radians(latitude), np.radians(longitude)
    north = np.log(np.tan(np.pi / 4 + latitude / 2))
    plane_m = EARTH_RADIUS_M * np.cos(latitude[0]) * np.stack([longitude, north])
    positions = np.column_stack([*plane_m, altitude])
    R_world_imu = Rotation.from_euler("ZYX", np.column_stack(angles[::-1])).as_matrix()
    T_world_imu = se3.pose(R_world_imu, positions - positions[0])
    T_imu_cam0 = se3.inverse(T_rectified_cam @ T_cam_velo @ T_velo_imu)
    return Trajectory(times, T_world_imu @ (T_imu_cam0 @ T_cam0_left))


def read_matrix(path: Path, key: str, shape: tuple[int, ...]) -> Array:
    """Read the numbers of the row that begins with a key, and a colon, blank or equals sign.

    Raises:
        CalibrationError: If there is no such row, or it has others or NaN, or is a projection
            (3, 4) without positive focal lengths; names file and line.
    """
    size = math.prod(shape)
    for number, line in enumerate(read_lines(path, CalibrationError), start=1):
        name, *values = line.replace(":", " ").replace("=", " ").split() or [""]
        if name == key:
            place = f"{path}:{number}: {key} must be"
            try:
                found = np.array(values, dtype=float).reshape(shape)
            except ValueError:
                raise CalibrationError(f"{place} {size} numbers") from None
            positive = np.diag(found) if shape == (3, 4) else np.ones(1)
            if not np.isfinite(found).all() or not (positive > 0).all():
                raise CalibrationError(f"{place} finite with positive focal lengths")
            return found
    raise CalibrationError(f"{path}: needs a row that begins with '{key}: ', {size} numbers")
