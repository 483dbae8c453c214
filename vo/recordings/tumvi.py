"""Reader of TUM-VI's `dso` folder: images, times in seconds and Kalibr's camchain."""

from pathlib import Path

from vo.contract.arrays import Array, Indices
from vo.contract.errors import CalibrationError
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.calibration import read_cameras
from vo.recordings.calibration_files import find_stereo_file
from vo.recordings.image_times import read_image_times
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles, pair_by_time
from vo.recordings.recording import open_recording
from vo.recordings.rectify import Camera
from vo.recordings.tables import SECONDS
from vo.recordings.truth_files import read_true_poses

ROW = "'name time[s] exposure[ms]'"


def is_tumvi(folder: Path) -> bool:
    """Whether the folder holds `dso/cam0/images`, or is the `dso` itself."""
    return (_root(folder) / "cam0" / "images").is_dir()


def open_tumvi(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the stereo pairs of `times.txt`; images are rectified on loading.

    Raises:
        DatasetError: If a table is missing or malformed, or images are.
        CalibrationError: If there is no file of both cameras, or it is malformed.
        SettingsError: If the selection is empty.
    """
    cameras, files = read_tumvi_cameras(folder), list_tumvi(folder, frames.tolerance_ms)
    return open_recording(folder, files, frames, lambda *_: cameras)


def read_tumvi_cameras(folder: Path) -> tuple[Camera, Camera]:
    """Read Kalibr's camchain.

    Raises:
        CalibrationError: If there is no file of both cameras, or it is malformed.
    """
    root = _root(folder)
    chain = find_stereo_file((root,))
    if chain is None:
        raise CalibrationError(f"{root}: holds no YAML file of both cameras, such as a camchain")
    return read_cameras(chain, chain, root / "cam0" / "images")


def list_tumvi(folder: Path, tolerance_ms: float | None = None) -> StereoFiles:
    """List the stereo pairs of the tables; the image files may be missing.

    Raises:
        DatasetError: If a table is missing or malformed, or no times agree.
    """
    left, right = (_read_times(_root(folder) / camera) for camera in ("cam0", "cam1"))
    return pair_by_time(folder, left, right, tolerance_ms)


def read_tumvi_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the rectified left camera from `gt_imu.csv`; None without that file.

    Raises:
        TrajectoryError: If the table is malformed.
    """
    table = _root(folder) / "gt_imu.csv"
    if not table.is_file():
        return None
    return read_true_poses(table, T_body_cam, _read_times(table.parent / "cam0")[0])


def _root(folder: Path) -> Path:
    return folder / "dso" if (folder / "dso").is_dir() else folder


def _read_times(camera: Path) -> tuple[Indices, list[Path]]:
    return read_image_times(camera / "times.txt", camera / "images", ROW, 1, SECONDS)
