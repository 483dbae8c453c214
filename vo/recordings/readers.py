"""Readers of all supported layouts; ground truth is read by a separate call."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.dataset import check_whole
from vo.contract.errors import CalibrationError, DatasetError
from vo.contract.inertial import ImuLog
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.euroc import (
    is_euroc,
    list_euroc,
    open_euroc,
    read_euroc_cameras,
    read_euroc_truth,
)
from vo.recordings.inertial_tables import read_imu_table
from vo.recordings.kitti import is_kitti, list_kitti, open_kitti, read_kitti_pose, read_kitti_truth
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles
from vo.recordings.rectify import rectify
from vo.recordings.ros.reader import (
    bag_name,
    list_bag,
    open_stereo_bag,
    read_bag_imu,
    read_bag_pose,
    read_bag_truth,
)
from vo.recordings.ros.topics import is_bag, split_choice
from vo.recordings.tartanair import (
    is_tartanair,
    list_tartanair,
    open_tartanair,
    read_tartanair_pose,
    read_tartanair_truth,
)
from vo.recordings.tartanair_labels import read_tartanair_labels

LAYOUTS = (
    "a driftyard, EuRoC or TUM-VI folder (mav0/cam0, or dso/cam0/images), KITTI odometry (image_0 "
    "or image_2, calib.txt), KITTI raw (image_00/data or image_02/data, calib_cam_to_cam.txt), "
    "TartanAir (image_left or image_lcam_front), or a bag of ROS (.bag, .mcap, .db3, or its folder)"
)


Labels = Mapping[str, Callable[[int], Array]]


@dataclass(frozen=True)
class Reader:
    """Functions that read one layout.

    Attributes:
        fits: Whether a folder has the layout.
        open: Opens the selected frames.
        pairs: Lists the stereo pairs within a tolerance in ms, or None for the default.
        T_body_cam: Reads (4, 4) of the rectified left camera.
        truth: Reads T_world_cam, given T_body_cam.
        imu: Reads the inertial readings.
        labels: Returns the readers of dense labels by name; each takes the time of a frame in ns.
    """

    fits: Callable[[Path], bool]
    open: Callable[[Path, FrameSelection], StereoSequence]
    pairs: Callable[[Path, float | None], StereoFiles]
    T_body_cam: Callable[[Path], Array]
    truth: Callable[[Path, Array], Trajectory | None]
    imu: Callable[[Path], ImuLog | None] = read_imu_table
    labels: Callable[[Path], Labels] = lambda _: {}


def _euroc_pose(folder: Path) -> Array:
    return rectify(*read_euroc_cameras(folder))[0].T_body_cam


def _kitti_pairs(folder: Path, _: float | None) -> StereoFiles:
    return list_kitti(folder)


READERS = (
    Reader(is_euroc, open_euroc, list_euroc, _euroc_pose, read_euroc_truth),
    Reader(is_kitti, open_kitti, _kitti_pairs, read_kitti_pose, read_kitti_truth),
    Reader(
        *(is_tartanair, open_tartanair, list_tartanair, read_tartanair_pose, read_tartanair_truth),
        labels=read_tartanair_labels,
    ),
    Reader(is_bag, open_stereo_bag, list_bag, read_bag_pose, read_bag_truth, read_bag_imu),
)
"""Readers in order of preference."""


def open_sequence(folder: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the selected frames of a recording by its layout.

    Inertial readings that are malformed are left out, with a remark when the first frame is read,
    and so are those of bags, which take long to read.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout, or its content is invalid.
        CalibrationError: If its calibration is missing, malformed or of no stereo pair.
        SettingsError: If the selection is empty.
    """
    reader = _reader(folder)
    sequence = reader.open(folder, frames)
    if reader.imu is not read_imu_table:
        return sequence

    def load_imu() -> ImuLog | None:
        try:
            return reader.imu(folder)
        except (DatasetError, CalibrationError) as error:
            remark(f"the gyroscope is not used: {error}")
            return None

    return replace(sequence, load_imu=load_imu)


def recording_name(folder: Path) -> str:
    """Return the name of a recording, for titles and files."""
    return bag_name(folder) if is_bag(folder) else folder.resolve().name


def find_recordings(folder: Path) -> list[Path]:
    """Find the recordings of all layouts in a folder, itself included, by name; not inside others.

    Raises:
        DatasetError: If the folder is missing.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    if _find_reader(folder) is not None:
        return [folder]
    inside = (x for x in sorted(folder.iterdir()) if x.is_dir() and not x.name.startswith("."))
    return [found for x in inside for found in find_recordings(x)]


def read_frame_times(folder: Path) -> Indices:
    """Read the times (N,) in ns of all stereo pairs within the widest tolerance.

    The image files may be missing.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout, or no images are paired.
    """
    return _reader(folder).pairs(folder, np.inf).timestamps_ns


def read_body_pose(folder: Path) -> Array:
    """Read T_body_cam (4, 4) of the rectified left camera.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout.
        CalibrationError: If its calibration is missing, malformed or of no stereo pair.
    """
    return _reader(folder).T_body_cam(folder)


def read_truth(folder: Path) -> Trajectory | None:
    """Read the true T_world_cam of the left camera; None where the recording has none.

    Only evaluation may call this; an estimator receives a StereoSequence, which has no truth.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout.
        CalibrationError: As `open_sequence`.
        TrajectoryError: If the truth is malformed.
    """
    reader = _reader(folder)
    return reader.truth(folder, reader.T_body_cam(folder))


def read_imu(folder: Path) -> ImuLog | None:
    """Read the readings of an inertial unit; None where the recording has none.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout, or readings are malformed.
        CalibrationError: If the unit's place in the body is malformed.
    """
    return _reader(folder).imu(folder)


def label_readers(folder: Path) -> Labels:
    """Return the readers of the dense labels that other tools wrote, by the names of this project.

    Only evaluation may call this, as `read_truth`.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout.
    """
    return _reader(folder).labels(folder)


def _reader(folder: Path) -> Reader:
    place = split_choice(folder)[0]
    if not place.exists():
        raise DatasetError(f"{place}: no such {'file' if place.suffix else 'folder'}")
    if folder.is_dir():
        check_whole(folder)
    if (reader := _find_reader(folder)) is not None:
        return reader
    names = sorted(folder.iterdir()) if folder.is_dir() else ()
    inside = next((x for x in names if _find_reader(x)), None)
    hint = "" if inside is None else f"; {inside} is one"
    raise DatasetError(f"{folder}: not a recording{hint}; expected {LAYOUTS}")


def _find_reader(folder: Path) -> Reader | None:
    return next((x for x in READERS if x.fits(folder)), None)
