"""Reader of the KITTI odometry layout."""

from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.files import read_grey, read_lines
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.contract.tables import SECONDS, read_table
from vo.contract.trajectory import Trajectory


def is_kitti(folder: Path) -> bool:
    """Whether the folder holds `image_0` and `calib.txt`."""
    return (folder / "image_0").is_dir() and (folder / "calib.txt").is_file()


def open_kitti(folder: Path) -> StereoSequence:
    """Open `image_0` and `image_1` (rectified grey) with `calib.txt` and `times.txt`.

    Raises:
        DatasetError: If files are missing, or left and right differ.
        CalibrationError: If calib.txt describes no stereo pair.
    """
    left, right = (sorted((folder / name).glob("*.png")) for name in ("image_0", "image_1"))
    if len(left) != len(right):
        raise DatasetError(f"{folder}: image_0 holds {len(left)} images, image_1 {len(right)}")
    if not left:
        raise DatasetError(f"{folder}: image_0 holds no images")
    for a, b in zip(left, right, strict=True):
        if a.name != b.name:
            raise DatasetError(f"{folder}: {a.name} in image_0 has no partner; found {b.name}")
    times = _read_times(folder / "times.txt")
    if len(times) != len(left):
        raise DatasetError(f"{folder / 'times.txt'}: {len(times)} times for {len(left)} images")
    height, width = read_grey(left[0]).shape
    rig = _read_rig(folder / "calib.txt", width, height)

    def load(i: int) -> tuple[Image, Image]:
        return read_grey(left[i]), read_grey(right[i])

    return StereoSequence(folder.resolve().name, rig, times, load)


def read_kitti_truth(folder: Path) -> Trajectory | None:
    """Read T_world_cam from `poses.txt` in the folder, or from the benchmark's `poses/NN.txt`.

    Raises:
        TrajectoryError: If a row is not 12 finite numbers, or rows and times differ.
    """
    folder = folder.resolve()
    candidates = (folder / "poses.txt", folder.parents[1] / "poses" / f"{folder.name}.txt")
    path = next((x for x in candidates if x.is_file()), None)
    if path is None:
        return None
    T = read_kitti_poses(path)
    times = _read_times(folder / "times.txt")
    if len(T) != len(times):
        raise TrajectoryError(f"{path}: {len(T)} poses for {len(times)} times")
    return Trajectory(times, T)


def read_kitti_poses(path: Path) -> Array:
    """Read rows of 12 numbers, each the top of T_world_cam, as (N, 4, 4).

    Raises:
        TrajectoryError: If the file is malformed; names file and line.
    """
    table, expected = read_table(path, TrajectoryError), "12 numbers, the top of a pose matrix"
    rows = table.numbers(range(12), expected)
    for i, row in enumerate(table.rows):
        if len(row) != 12:
            raise table.fault(i, f"{len(row)} columns; expected {expected}")
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows.reshape(-1, 3, 4)
    return T


def _read_times(path: Path) -> Indices:
    return read_table(path).times_ns("a time in seconds", SECONDS)


def _read_rig(path: Path, width: int, height: int) -> StereoRig:
    rows: dict[str, Array] = {}
    for line in read_lines(path, CalibrationError):
        key, _, values = line.partition(":")
        if key in ("P0", "P1"):
            try:
                rows[key] = np.array(values.split(), dtype=float).reshape(3, 4)
            except ValueError:
                raise CalibrationError(f"{path}: {key} must be 12 numbers") from None
    if set(rows) != {"P0", "P1"}:
        raise CalibrationError(f"{path}: needs rows P0 and P1")
    P0, P1 = rows["P0"], rows["P1"]
    if not (np.isfinite(P0).all() and np.isfinite(P1).all()) or P0[0, 0] <= 0:
        raise CalibrationError(f"{path}: P0 and P1 must be finite with a positive focal length")
    try:
        return StereoRig(width, height, P0[0, 0], P0[0, 2], P0[1, 2], (P0 - P1)[0, 3] / P0[0, 0])
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None
