"""Reader of KITTI's layouts: odometry benchmark and synchronised, rectified raw data."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.images import list_images
from vo.recordings.kitti_raw import read_dates, read_matrix, read_oxts
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles, pair_by_name
from vo.recordings.pose_tables import matrix_poses
from vo.recordings.recording import open_recording
from vo.recordings.rectify import Camera
from vo.recordings.tables import SECONDS, read_table
from vo.recordings.truth_files import read_true_poses

MAX_OFF_AXIS = 0.02
"""Largest offset of the right eye along y or z, in baselines; that of KITTI's colour pair is 0.005.
Rows of KITTI's pairs are aligned, whatever this offset."""


@dataclass(frozen=True)
class Layout:
    """Places of one stereo pair inside a folder: images, keys of the projections, times."""

    left: str
    right: str
    keys: tuple[str, str]
    times: str
    calibrations: tuple[str, ...] = ("calib.txt",)


def _raw(left: str, right: str) -> Layout:
    name = "calib_cam_to_cam.txt"
    keys = (f"P_rect_{left}", f"P_rect_{right}")
    eyes = f"image_{left}/data", f"image_{right}/data"
    return Layout(*eyes, keys, f"image_{left}/timestamps.txt", (name, f"../{name}"))


POSITIONS = ("groundtruth.txt", "groundtruth.csv", "gt.txt", "gt.csv", "gt_xy.csv")
"""Tables of the positions of a point beside a pair without true poses, with named columns."""
LAYOUTS = (
    Layout("image_0", "image_1", ("P0", "P1"), "times.txt"),
    Layout("image_2", "image_3", ("P2", "P3"), "times.txt"),
    _raw("00", "01"),
    _raw("02", "03"),
)
"""Grey before colour, odometry before raw."""


def is_kitti(folder: Path) -> bool:
    """Whether the folder holds the images of a left eye, such as `image_0` or `image_00/data`."""
    return any((folder / x.left).is_dir() for x in LAYOUTS)


def open_kitti(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open a rectified pair with its calibration and times: the grey one if both are complete.

    The body frame is that of the left grey camera, to which KITTI's true poses belong.

    Raises:
        DatasetError: If files are missing, or images and times do not fit.
        CalibrationError: If the calibration describes no stereo pair.
        SettingsError: If the selection is empty.
    """
    layout = _layout(folder)

    def cameras(width: int, height: int) -> tuple[Camera, Camera]:
        return _cameras(folder, layout, width, height)

    return open_recording(folder, list_kitti(folder), frames, cameras)


def list_kitti(folder: Path) -> StereoFiles:
    """List the stereo pairs.

    Raises:
        DatasetError: If there are no images, or times that do not fit.
    """
    layout = _layout(folder)
    left, right = (list_images(folder / x) for x in (layout.left, layout.right))
    for files, name in ((left, layout.left), (right, layout.right)):
        if not files:
            raise DatasetError(f"{folder / name}: holds no images")
    table = folder / layout.times
    times = read_dates(table) if table.name == "timestamps.txt" else _read_times(table)
    for row in np.flatnonzero(np.diff(times) <= 0):
        raise DatasetError(f"{table}: time must increase, but that of row {row + 2} does not")
    return pair_by_name(folder, left, right, times, table)


def _layout(folder: Path) -> Layout:
    """Return the first layout with both eyes, or the first with the left one, for an error."""
    started = [x for x in LAYOUTS if (folder / x.left).is_dir()]
    complete = (x for x in started if (folder / x.right).is_dir())
    return next(complete, started[0])


def read_kitti_pose(folder: Path) -> Array:
    """Read the pose (4, 4) of the left camera in the left grey one, which is the body frame.

    Raises:
        CalibrationError: If the calibration describes no stereo pair.
    """
    return _eyes(folder, _layout(folder))[0]


def read_kitti_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read the left camera's T_world_cam from `poses.txt`, `poses/NN.txt`, or raw data's `oxts`.

    Without these, the first of POSITIONS is taken, with a remark. T_body_cam (4, 4) is the left
    camera in the left grey one.

    Raises:
        TrajectoryError: If a row is not 12 finite numbers, or rows and times differ.
    """
    path = next((x for x in pose_files(folder.resolve()) if x.is_file()), None)
    if path is None:
        table = next(filter(Path.is_file, (folder / x for x in POSITIONS)), None)
        if table is None:
            return read_oxts(folder, T_body_cam)
        return read_true_poses(table, T_body_cam, list_kitti(folder).timestamps_ns)
    T = read_kitti_poses(path)
    times = _read_times(folder / "times.txt")
    if len(T) != len(times):
        raise TrajectoryError(f"{path}: {len(T)} poses for {len(times)} times")
    return Trajectory(times, T @ T_body_cam)


def pose_files(folder: Path) -> tuple[Path, Path]:
    """Return the places of the true poses of an absolute folder: its own, and the benchmark's."""
    return folder / "poses.txt", folder.parent.parent / "poses" / f"{folder.name}.txt"


def read_kitti_poses(path: Path) -> Array:
    """Read rows of 12 numbers, each the top of T_world_cam, as (N, 4, 4).

    Raises:
        TrajectoryError: If the file is malformed; names file and line.
    """
    return matrix_poses(read_table(path, TrajectoryError))


def _read_times(path: Path) -> Indices:
    table, expected = read_table(path), "a time in seconds"
    stamps = table.stamps(0, expected)
    return table.in_ns(stamps, table.unit_ns(stamps, SECONDS))


def _cameras(folder: Path, layout: Layout, width: int, height: int) -> tuple[Camera, Camera]:
    T_left, T_right, calibration = _eyes(folder, layout)
    P = {key: read_matrix(calibration, key, (3, 4)) for key in layout.keys}
    left, right = (
        Camera(calibration, width, height, P[key][:, :3] / P[key][2, 2], np.zeros(4), T)
        for key, T in zip(layout.keys, (T_left, T_right), strict=True)
    )
    return left, right


def _eyes(folder: Path, layout: Layout) -> tuple[Array, Array, Path]:
    """Return T_cam0_left and T_cam0_right of the rectified pair, and the file of calibrations."""
    files = [folder / x for x in layout.calibrations]
    path = next((x for x in files if x.is_file()), files[0])
    P = {key: read_matrix(path, key, (3, 4)) for key in layout.keys}
    left, right = (_origin(P[key]) for key in layout.keys)
    baseline_m = right[0] - left[0]
    if np.abs(right - left)[1:].max() > MAX_OFF_AXIS * abs(baseline_m):
        names = " and ".join(layout.keys)
        raise CalibrationError(f"{path}: {names} are not side by side; expected a rectified pair")
    T_left, T_right = np.eye(4), np.eye(4)
    T_left[:3, 3], T_right[:3, 3] = left, left + np.array([baseline_m, 0, 0])
    return T_left, T_right, path


def _origin(P: Array) -> Array:
    """Return the origin in the left grey camera of the camera with projection P = K [I | t]."""
    z = P[2, 3] / P[2, 2]
    x, y = ((P[k, 3] / P[2, 2] - P[k, 2] / P[2, 2] * z) * P[2, 2] / P[k, k] for k in (0, 1))
    return np.array([-x, -y, -z]) + 0.0
