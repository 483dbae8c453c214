"""Reader of TartanAir's trajectory folders, such as `Easy/P000` (V1) and `Data_easy/P000` (V2).

Source: Wang et al., TartanAir: a dataset to push the limits of visual SLAM, IROS 2020; its pages on
data types and modalities (tartanair.org).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import NS_PER_S, Trajectory
from vo.recordings.images import grey_reader, list_images, number_of
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles, pair_by_name
from vo.recordings.pose_tables import PoseColumns
from vo.recordings.recording import open_recording
from vo.recordings.rectify import Camera
from vo.recordings.tables import SECONDS, read_table

PERIOD_NS = 100_000_000
"""Period of the frames, whose times V1 does not have."""

F_PX, BASELINE_M, CENTRES = 320.0, 0.25, {(640, 480): (320.0, 240.0), (640, 640): (320.0, 320.0)}
"""Calibration of V1 and V2, which have no file of it: principal points by the size of images."""

CAMERA_KEYS = ("fx", "fy", "cx", "cy", "width", "height", "baseline")
"""Keys of `camera.json`, which this project's exports hold: px, and metres."""

POSES = PoseColumns(0, (0, 1, 2), (6, 3, 4, 5))
R_NED_OPTICAL = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""Axes of images (right, down, forward) in those of TartanAir's cameras: forward, right, down."""
T_NED_WORLD = se3.pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""World with z up in TartanAir's, north, east, down: turned by 180 degrees about x."""
T_OPTICAL_CAMERA = se3.pose(R_NED_OPTICAL.T.astype(float), np.zeros(3))


@dataclass(frozen=True)
class Layout:
    """Names of folders and files of a version."""

    left: str
    right: str
    pose: str
    depth: str
    flow: str
    segmentation: str


V1 = Layout("image_left", "image_right", "pose_left.txt", "depth_left", "flow", "seg_left")
V2 = Layout(
    *("image_lcam_front", "image_rcam_front", "pose_lcam_front.txt"),
    *("depth_lcam_front", "flow_lcam_front", "seg_lcam_front"),
)


def is_tartanair(folder: Path) -> bool:
    """Whether the folder holds the images of a left camera of TartanAir."""
    return any((folder / x.left).is_dir() for x in (V1, V2))


def layout_of(folder: Path) -> Layout:
    """Return the version of a folder."""
    return V2 if (folder / V2.left).is_dir() else V1


def open_tartanair(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the rectified pairs; the body is the left camera.

    Raises:
        DatasetError: If images are missing, or times do not fit.
        CalibrationError: If `camera.json` is malformed, or missing for images of another size.
        SettingsError: If the selection is empty.
    """

    def cameras(width: int, height: int) -> tuple[Camera, Camera]:
        return read_tartanair_cameras(folder, (width, height))

    return open_recording(folder, list_tartanair(folder), frames, cameras)


def list_tartanair(folder: Path, _: float | None = None) -> StereoFiles:
    """List the stereo pairs, by the numbers in the names of their images.

    Raises:
        DatasetError: If images are missing, or times do not fit.
    """
    layout = layout_of(folder)
    left, right = (list_images(folder / x) for x in (layout.left, layout.right))
    for files, name in ((left, layout.left), (right, layout.right)):
        if not files:
            raise DatasetError(f"{folder / name}: holds no images; a stereo pair needs both eyes")
        for file in files:
            if frame_number(file) < 0:
                raise DatasetError(f"{file}: expected a name such as 000000_left.png")
    times, source = _times(folder, left)
    return pair_by_name(folder, left, right, times, source, _number)


def frame_number(file: Path) -> int:
    """Return the number with which a name begins; -1 if it does not."""
    return number_of(_number(file))


def _number(file: Path) -> str:
    return file.stem.partition("_")[0]


def _times(folder: Path, images: Sequence[Path]) -> tuple[Indices, Path]:
    """Read the times of the frames of all numbers, ns, and return the file."""
    text, binary = (folder / "imu" / f"cam_time.{x}" for x in ("txt", "npy"))
    if text.is_file():
        table, expected = read_table(text), "a time in seconds"
        stamps = table.stamps(0, expected)
        times = table.in_ns(stamps, table.unit_ns(stamps, SECONDS))
        table.require_increasing(times)
        return times, text
    if binary.is_file():
        seconds = read_array(binary).ravel().astype(np.float64)
        times = np.rint(seconds * NS_PER_S).astype(np.int64)
        if not np.isfinite(seconds).all() or (np.diff(times) <= 0).any():
            raise DatasetError(f"{binary}: expected times in seconds that increase")
        return times, binary
    remark(f"{folder}: has no imu/cam_time.txt; frames are taken at 10 Hz")
    return np.arange(frame_number(images[-1]) + 1) * PERIOD_NS, folder


def read_tartanair_cameras(
    folder: Path, size_px: tuple[int, int] | None = None
) -> tuple[Camera, Camera]:
    """Read `camera.json`; without it, return the calibration of V1 or V2.

    Raises:
        CalibrationError: If a key is missing or malformed, or the images are of another size.
    """
    path, T_left_right = folder / "camera.json", np.eye(4)
    if path.is_file():
        fx, fy, cx, cy, width, height, baseline_m = _camera_values(path)
    else:
        if size_px is None:
            size_px = grey_reader(list_images(folder / layout_of(folder).left)[:1]).size_px
        if size_px not in CENTRES:
            sizes = " or ".join(f"{w}x{h}" for w, h in CENTRES)
            raise CalibrationError(
                f"{path}: missing; images are {size_px[0]}x{size_px[1]}, those of TartanAir {sizes}"
                f"; expected this file with {', '.join(CAMERA_KEYS)}"
            )
        (width, height), (cx, cy), baseline_m = size_px, CENTRES[size_px], BASELINE_M
        fx = fy = F_PX
    T_left_right[0, 3] = baseline_m
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    left, right = (
        Camera(path, int(width), int(height), K, np.zeros(4), T) for T in (np.eye(4), T_left_right)
    )
    return left, right


def _camera_values(path: Path) -> list[float]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return [float(content[x]) for x in CAMERA_KEYS]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise CalibrationError(f"{path}: expected numbers for {', '.join(CAMERA_KEYS)}") from None


def read_tartanair_pose(_: Path) -> Array:
    """Return T_body_cam (4, 4): the body is the left camera."""
    return np.eye(4)


def read_tartanair_truth(folder: Path, _: Array) -> Trajectory | None:
    """Read T_world_cam of the left camera in a world with z up; None without a file of poses.

    Raises:
        TrajectoryError: If a row is malformed, or rows and times differ; names file and line.
    """
    layout = layout_of(folder)
    path = folder / layout.pose
    if not path.is_file():
        return None
    table = read_table(path, TrajectoryError)
    T_ned = POSES.poses(table, "'tx ty tz qx qy qz qw' in north, east, down")
    times, source = _times(folder, list_images(folder / layout.left))
    if len(times) != len(T_ned):
        raise TrajectoryError(f"{path}: {len(T_ned)} poses for {len(times)} times of {source}")
    return Trajectory(times, se3.inverse(T_NED_WORLD) @ T_ned @ se3.inverse(T_OPTICAL_CAMERA))


def read_array(path: Path) -> Array:
    """Read an array of numbers from a file of NumPy's.

    Raises:
        DatasetError: If it is missing, damaged or holds other values.
    """
    try:
        values = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DatasetError(f"{path}: cannot be read ({error})") from None
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        raise DatasetError(f"{path}: expected an array of numbers")
    return values
