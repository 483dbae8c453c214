"""Reader of EuRoC/ASL folders, raw or rectified, and of this project's datasets."""

from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import CalibrationError
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence, WheelLog
from vo.contract.trajectory import Trajectory
from vo.recordings.calibration import read_cameras
from vo.recordings.calibration_files import find_stereo_file
from vo.recordings.image_times import read_image_times
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles, pair_by_time
from vo.recordings.recording import open_recording
from vo.recordings.rectify import Camera
from vo.recordings.tables import NS, read_table
from vo.recordings.truth_files import read_true_states

IMAGE_ROW = "'timestamp [ns],filename'"


def is_euroc(folder: Path) -> bool:
    """Whether the folder holds `mav0/cam0`, or is the `mav0` itself."""
    camera = _mav(folder) / "cam0"
    return camera.is_dir() and not (camera / "images").is_dir()


def open_euroc(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the stereo pairs of an ASL folder; images are rectified on loading.

    Wheel encoders are read from `wheels0`, a table that this project adds to the layout.

    Raises:
        DatasetError: If a table is missing or malformed, or images are.
        CalibrationError: If a calibration is incomplete or does not describe a stereo pair.
        SettingsError: If the selection is empty.
    """
    cameras = read_euroc_cameras(folder)
    wheels = _read_wheels(_mav(folder) / "wheels0" / "data.csv")
    files = list_euroc(folder, frames.tolerance_ms)
    return open_recording(folder, files, frames, lambda *_: cameras, wheels)


def list_euroc(folder: Path, tolerance_ms: float | None = None) -> StereoFiles:
    """List the stereo pairs of the tables; the image files may be missing.

    Raises:
        DatasetError: If a table is missing or malformed, or no times agree.
    """
    eyes = [_read_image_table(_mav(folder) / camera) for camera in ("cam0", "cam1")]
    return pair_by_time(folder, eyes[0], eyes[1], tolerance_ms)


def read_euroc_cameras(folder: Path) -> tuple[Camera, Camera]:
    """Read both sensor.yaml, or a file of both cameras in `mav0`, beside it or in TUM-VI's `dso`.

    In place of a sensor.yaml, the only YAML file beside it is read.

    Raises:
        CalibrationError: If a calibration is missing or malformed.
    """
    mav = _mav(folder)
    sheets = [_sheet(mav / camera) for camera in ("cam0", "cam1")]
    if not any(x.is_file() for x in sheets):
        parent = mav.resolve().parent
        chain = find_stereo_file((mav, parent, parent / "dso"))
        if chain is None:
            raise CalibrationError(
                f"{sheets[0]}: missing; expected it, or in {mav} or {parent} a YAML file of both "
                "cameras, of Kalibr, ORB-SLAM, VINS-Fusion or OpenCV"
            )
        remark(f"{sheets[0]}: missing; the calibration is that of {chain}")
        sheets = [chain, chain]
    return read_cameras(sheets[0], sheets[1], mav / "cam0" / "data")


def _sheet(camera: Path) -> Path:
    """Return the calibration of a camera: sensor.yaml, or the only YAML file in its place."""
    sheet, others = camera / "sensor.yaml", sorted(camera.glob("*.y*ml"))
    if sheet in others or len(others) != 1:
        return sheet
    remark(f"{sheet}: missing; the calibration is that of {others[0]}")
    return others[0]


def read_euroc_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the (rectified) left camera, as `read_true_states`."""
    mav = _mav(folder)
    return read_true_states(mav, T_body_cam, _read_image_table(mav / "cam0")[0])


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
    return read_image_times(camera / "data.csv", camera / "data", IMAGE_ROW, 0, NS)
