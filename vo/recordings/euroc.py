"""Reader of EuRoC/ASL folders, raw or rectified, as this project writes them, and of TUM-VI."""

from dataclasses import dataclass
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
from vo.recordings.tables import NS, SECONDS, read_table
from vo.recordings.truth_files import read_true_states


@dataclass(frozen=True)
class Layout:
    """Names in a recording.

    Attributes:
        root: Folder of the cameras; the recording may be that folder itself.
        table: Table of images of a camera, with times and names in its first two columns.
        images: Folder of the images of a camera.
        row: The columns of the table, for errors.
        time: Index of the column of times.
        unit_ns: Unit of times where nothing else shows it.
        truths: Tables of the truth, the best first.
    """

    root: str
    table: str
    images: str
    row: str
    time: int
    unit_ns: int
    truths: tuple[str, ...]

    def place(self, folder: Path) -> Path:
        """Return the folder of the cameras."""
        return folder / self.root if (folder / self.root).is_dir() else folder

    def image_times(self, folder: Path, camera: str) -> tuple[Indices, list[Path]]:
        """Read the times (N,) in ns of the images of a camera, and their files."""
        eye = self.place(folder) / camera
        table, images = eye / self.table, eye / self.images
        return read_image_times(table, images, self.row, self.time, self.unit_ns)


SENSORS = ("state_groundtruth_estimate0", "mocap0", "vicon0", "leica0")
TRUTHS = tuple(f"{sensor}/data.csv" for sensor in SENSORS)
EUROC = Layout("mav0", "data.csv", "data", "'timestamp [ns],filename'", 0, NS, TRUTHS)
TUMVI = Layout(
    "dso", "times.txt", "images", "'name time[s] exposure[ms]'", 1, SECONDS, ("gt_imu.csv",)
)


def is_euroc(folder: Path) -> bool:
    """Whether the folder holds `mav0/cam0` or `dso/cam0/images`, or is `mav0` or `dso` itself."""
    layout = _layout(folder)
    return layout is EUROC or (layout.place(folder) / "cam0" / layout.images).is_dir()


def open_euroc(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the stereo pairs of a folder; images are rectified on loading.

    Wheel encoders are read from `wheels0`, a table that this project adds to the layout.

    Raises:
        DatasetError: If a table is missing or malformed, or images are.
        CalibrationError: If a calibration is incomplete or does not describe a stereo pair.
        SettingsError: If the selection is empty.
    """
    cameras = read_euroc_cameras(folder)
    wheels = _read_wheels(_layout(folder).place(folder) / "wheels0" / "data.csv")
    files = list_euroc(folder, frames.tolerance_ms)
    return open_recording(folder, files, frames, lambda *_: cameras, wheels)


def list_euroc(folder: Path, tolerance_ms: float | None = None) -> StereoFiles:
    """List the stereo pairs of the tables; the image files may be missing.

    Raises:
        DatasetError: If a table is missing or malformed, or no times agree.
    """
    left, right = (_layout(folder).image_times(folder, camera) for camera in ("cam0", "cam1"))
    return pair_by_time(folder, left, right, tolerance_ms)


def read_euroc_cameras(folder: Path) -> tuple[Camera, Camera]:
    """Read both sensor.yaml, or a file of both cameras in the root, beside it or in `dso`.

    In place of a sensor.yaml, the only YAML file beside it is read.

    Raises:
        CalibrationError: If a calibration is missing or malformed.
    """
    layout = _layout(folder)
    root = layout.place(folder)
    sheets = [_sheet(root / camera) for camera in ("cam0", "cam1")]
    if not any(x.is_file() for x in sheets):
        parent = root.resolve().parent
        both = find_stereo_file((root, parent, parent / TUMVI.root))
        if both is None:
            raise CalibrationError(
                f"{sheets[0]}: missing; expected it, or in {root} or {parent} a YAML file of both "
                "cameras, of Kalibr, ORB-SLAM, VINS-Fusion or OpenCV"
            )
        if layout is EUROC:
            remark(f"{sheets[0]}: missing; the calibration is that of {both}")
        sheets = [both, both]
    return read_cameras(sheets[0], sheets[1], root / "cam0" / layout.images)


def _sheet(camera: Path) -> Path:
    """Return the calibration of a camera: sensor.yaml, or the only YAML file in its place."""
    sheet, others = camera / "sensor.yaml", sorted(camera.glob("*.y*ml"))
    if sheet in others or len(others) != 1:
        return sheet
    remark(f"{sheet}: missing; the calibration is that of {others[0]}")
    return others[0]


def read_euroc_truth(folder: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the (rectified) left camera, as `read_true_states`."""
    layout = _layout(folder)
    tables = [layout.place(folder) / x for x in layout.truths]
    return read_true_states(tables, T_body_cam, layout.image_times(folder, "cam0")[0])


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


def _layout(folder: Path) -> Layout:
    """Return EuRoC's layout if the folder has its cameras, else TUM-VI's."""
    camera = EUROC.place(folder) / "cam0"
    return EUROC if camera.is_dir() and not (camera / TUMVI.images).is_dir() else TUMVI
