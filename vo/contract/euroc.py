"""Reader of EuRoC/ASL folders: this project's own and anyone's, raw or rectified."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.files import read_grey
from vo.contract.rectify import PinholeCamera, rectify
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.contract.wheels import read_wheels

TRUTH_FOLDER = "state_groundtruth_estimate0"


def is_euroc(folder: Path) -> bool:
    """Whether the folder holds `mav0/cam0`, or is the `mav0` itself."""
    return (_mav(folder) / "cam0").is_dir()


def open_euroc(folder: Path) -> StereoSequence:
    """Open the stereo pair of an ASL folder; distorted or unaligned eyes are rectified on loading.

    Wheel encoders are taken from `wheels0`, a table that this project adds to the layout.

    Raises:
        DatasetError: If a table is missing or malformed, or left and right differ.
        CalibrationError: If a sensor.yaml is incomplete or describes no stereo pair.
    """
    mav = _mav(folder)
    left, right = (_read_camera(mav / eye / "sensor.yaml") for eye in ("cam0", "cam1"))
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

    wheels = read_wheels(mav / "wheels0" / "data.csv")
    return StereoSequence(folder.resolve().name, rig, times, load, wheels)


def read_euroc_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the (rectified) left camera, or None where the folder has no full poses.

    Raises:
        TrajectoryError: If the table is malformed.
    """
    table = _mav(folder) / TRUTH_FOLDER / "data.csv"
    if not table.is_file():
        return None
    try:
        rows = np.loadtxt(table, delimiter=",", comments="#", usecols=range(1, 8), ndmin=2)
        times = np.loadtxt(table, delimiter=",", comments="#", usecols=0, dtype=np.int64, ndmin=1)
    except (ValueError, IndexError) as error:
        raise TrajectoryError(f"{table}: {error}") from None
    if len(times) == 0:
        raise TrajectoryError(f"{table}: holds no poses")
    T_world_body = se3.from_quat_wxyz(rows[:, 3:7], rows[:, :3])
    return Trajectory(times, T_world_body @ T_body_cam)


def _mav(folder: Path) -> Path:
    return folder / "mav0" if (folder / "mav0").is_dir() else folder


def _read_image_table(camera: Path) -> tuple[Indices, list[Path]]:
    table = camera / "data.csv"
    times: list[int] = []
    files: list[Path] = []
    try:
        lines = table.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise DatasetError(f"{table}: cannot be read ({error.strerror})") from None
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        words = [word.strip() for word in line.split(",")]
        if len(words) < 2 or not words[0].isdigit() or not words[1]:
            raise DatasetError(f"{table}:{number}: expected 'timestamp [ns],filename'")
        times.append(int(words[0]))
        files.append(camera / "data" / words[1])
    return np.array(times, dtype=np.int64), files


def _read_camera(path: Path) -> PinholeCamera:
    content = _read_yaml(path)
    try:
        model = str(content.get("camera_model", "pinhole"))
        if model != "pinhole":
            raise CalibrationError(f"{path}: camera_model {model}; this program reads pinhole")
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
        raise CalibrationError(
            f"{path}: distortion_model {name}; this program reads radial-tangential"
        )
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return PinholeCamera(path, width, height, K, distortion, T_body_cam)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        # OpenCV writes a version line that is not YAML 1.1.
        content = yaml.safe_load("\n".join(x for x in lines if not x.startswith("%YAML:")))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror})") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise CalibrationError(f"{path}: not valid YAML") from None
    if not isinstance(content, dict):
        raise CalibrationError(f"{path}: holds no calibration")
    return content
