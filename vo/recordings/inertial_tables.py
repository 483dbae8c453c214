"""Reader of inertial readings: EuRoC's and TUM-VI's tables, which have the same columns."""

from pathlib import Path

import numpy as np

from vo.contract.inertial import ImuLog
from vo.recordings.calibration import read_sensor_pose
from vo.recordings.tables import NS, read_table

PLACES = ("mav0/imu0/data.csv", "imu0/data.csv", "dso/imu.txt", "imu.txt")
"""Tables below the folder of a recording, which may be `mav0` or `dso` itself."""
EXPECTED = "'timestamp [ns], wx, wy, wz [rad/s], ax, ay, az [m/s²]'"


def read_imu_table(folder: Path) -> ImuLog | None:
    """Read the inertial readings of a recording; None where it has no table of them.

    Its sensor.yaml gives the unit's place in the body; without one, the unit is the body.

    Raises:
        DatasetError: If a row is malformed, or time does not increase; names file and line.
        CalibrationError: If the sensor.yaml is malformed.
    """
    path = next((x for name in PLACES if (x := folder / name).is_file()), None)
    if path is None:
        return None
    table = read_table(path)
    times_ns, readings = table.times_ns(EXPECTED, NS), table.numbers(range(1, 7), EXPECTED)
    table.require_increasing(times_ns)
    sheet = path.with_name("sensor.yaml")
    T_body_imu = read_sensor_pose(sheet) if sheet.is_file() else None
    return ImuLog(
        times_ns, readings[:, :3], readings[:, 3:], np.eye(4) if T_body_imu is None else T_body_imu
    )
