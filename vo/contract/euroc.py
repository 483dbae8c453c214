"""Reader of EuRoC/ASL folders, raw or rectified, and of this project's datasets."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.files import read_grey, read_lines
from vo.contract.rectify import PinholeCamera, rectify
from vo.contract.sequence import StereoSequence, WheelLog
from vo.contract.tables import NS, read_table
from vo.contract.trajectory import Trajectory

TRUTH_FOLDER = "state_groundtruth_estimate0"
STATE = "'timestamp [ns], px, py, pz, qw, qx, qy, qz'"
IMAGE_ROW = "'timestamp [ns],filename'"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")


def is_euroc(folder: Path) -> bool:
    """Whether the folder holds `mav0/cam0`, or is the `mav0` itself."""
    return (_mav(folder) / "cam0").is_dir()


def open_euroc(folder: Path) -> StereoSequence:
    """Open the stereo pair of an ASL folder; images are rectified on loading.

    Wheel encoders are read from `wheels0`, a table that this project adds to the layout.

    Raises:
        DatasetError: If a table is missing or malformed, or left and right differ.
        CalibrationError: If a sensor.yaml is incomplete or does not describe a stereo pair.
    """
    mav = _mav(folder)
    left, right = (_read_camera(mav / camera / "sensor.yaml") for camera in ("cam0", "cam1"))
    times, files_left = _read_image_table(mav / "cam0")
    times_right, files_right = _read_image_table(mav / "cam1")
    if len(times) != len(times_right):
        raise DatasetError(f"{folder}: cam0 lists {len(times)} images, cam1 {len(times_right)}")
    if (times != times_right).any():
        i = int(np.argmax(times != times_right))
        raise DatasetError(
            f"{folder}: frame {i} is at {times[i]} ns left, {times_right[i]} ns right"
        )
    rig, remap_left, remap_right = rectify(left, right)

    def load(i: int) -> tuple[Image, Image]:
        return remap_left(read_grey(files_left[i])), remap_right(read_grey(files_right[i]))

    wheels = _read_wheels(mav / "wheels0" / "data.csv")
    return StereoSequence(folder.resolve().name, rig, times, load, wheels)


def read_euroc_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the (rectified) left camera; None where the folder has no full poses.

    Raises:
        TrajectoryError: If the table is malformed.
    """
    table = _mav(folder) / TRUTH_FOLDER / "data.csv"
    if not table.is_file():
        return None
    states = read_table(table, TrajectoryError)
    if len(states) == 0:
        raise TrajectoryError(f"{table}: holds no poses")
    times, rows = states.times_ns(STATE), states.numbers(range(1, 8), STATE)
    states.require_increasing(times)
    return Trajectory(times, se3.from_quat_wxyz(rows[:, 3:7], rows[:, :3]) @ T_body_cam)


def _read_wheels(path: Path) -> WheelLog | None:
    """Read rows of 'timestamp [ns],left [ticks],right [ticks]'; None without such a file."""
    if not path.is_file():
        return None
    table, expected = read_table(path), "'timestamp [ns],left [ticks],right [ticks]', whole numbers"
    times, ticks = table.times_ns(expected, NS), table.numbers((1, 2), expected)
    for i, row in enumerate(table.rows):
        if len(row) != 3 or (ticks[i] % 1).any():
            raise table.fault(i, f"expected {expected}")
    table.require_increasing(times)
    return WheelLog(times, ticks.astype(np.int64))


def _mav(folder: Path) -> Path:
    return folder / "mav0" if (folder / "mav0").is_dir() else folder


def _read_image_table(camera: Path) -> tuple[Indices, list[Path]]:
    table = read_table(camera / "data.csv")
    times, names = table.times_ns(IMAGE_ROW), table.words(1, IMAGE_ROW)
    table.require_increasing(times)
    return times, [_image_file(camera / "data", name) for name in names]


def _image_file(folder: Path, name: str) -> Path:
    """Return the file of a name with or without suffix; .png if there is no such file."""
    if name.lower().endswith(IMAGE_SUFFIXES):
        return folder / name
    files = [folder / f"{name}{suffix}" for suffix in IMAGE_SUFFIXES]
    return next((x for x in files if x.is_file()), files[0])


def _read_camera(path: Path) -> PinholeCamera:
    content = _read_yaml(path)
    try:
        model = str(content.get("camera_model", "pinhole"))
        if model != "pinhole":
            raise CalibrationError(f"{path}: camera_model {model}; expected pinhole")
        width, height = (int(x) for x in content["resolution"])
        fx, fy, cx, cy = (float(x) for x in content["intrinsics"])
        distortion = np.array(content.get("distortion_coefficients") or [0.0], dtype=float)
        T_body_cam = np.array(content["T_BS"]["data"], dtype=float).reshape(4, 4)
    except KeyError as error:
        raise CalibrationError(f"{path}: key {error} is missing") from None
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: {error}") from None
    name = str(content.get("distortion_model", "radial-tangential"))
    if distortion.any() and name not in ("radial-tangential", "radtan", "plumb_bob"):
        raise CalibrationError(f"{path}: distortion_model {name}; expected radial-tangential")
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return PinholeCamera(path, width, height, K, distortion, T_body_cam)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        # OpenCV writes a version line that is not YAML 1.1.
        lines = (x for x in read_lines(path, CalibrationError) if not x.startswith("%YAML:"))
        content = yaml.safe_load("\n".join(lines))
    except yaml.YAMLError:
        raise CalibrationError(f"{path}: not valid YAML") from None
    if not isinstance(content, dict):
        raise CalibrationError(f"{path}: holds no calibration")
    return content
