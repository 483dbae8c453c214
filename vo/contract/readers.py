"""Readers of all supported layouts; ground truth is read by a separate call."""

from pathlib import Path

from vo.contract.dataset import check_whole
from vo.contract.errors import DatasetError
from vo.contract.euroc import is_euroc, open_euroc, read_euroc_truth
from vo.contract.kitti import is_kitti, open_kitti, read_kitti_truth
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory

LAYOUTS = "a driftyard or EuRoC folder (mav0/cam0), or KITTI odometry (image_0, calib.txt)"


def open_sequence(folder: Path) -> StereoSequence:
    """Open a recording by its layout.

    Raises:
        DatasetError: If the folder is missing or of an unknown layout, or its content is invalid.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    check_whole(folder)
    if is_euroc(folder):
        return open_euroc(folder)
    if is_kitti(folder):
        return open_kitti(folder)
    raise DatasetError(f"{folder}: not a recording; expected {LAYOUTS}")


def read_truth(folder: Path) -> Trajectory | None:
    """Read the true T_world_cam of the left camera; None where the recording has none.

    Only evaluation may call this; an estimator receives a StereoSequence, which has no truth.
    """
    sequence = open_sequence(folder)
    if is_euroc(folder):
        return read_euroc_truth(folder, sequence.rig.T_body_cam)
    return read_kitti_truth(folder)
