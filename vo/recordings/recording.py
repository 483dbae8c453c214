"""A stereo sequence made of image files and two calibrations."""

from collections.abc import Callable
from pathlib import Path

from vo.contract.arrays import Image
from vo.contract.errors import DatasetError
from vo.contract.sequence import StereoSequence, WheelLog
from vo.recordings.images import grey_reader
from vo.recordings.pairing import FrameSelection, StereoFiles
from vo.recordings.rectify import Camera, rectify

Cameras = Callable[[int, int], tuple[Camera, Camera]]
"""Takes width and height of the images; returns the left and the right camera."""


def open_recording(
    folder: Path,
    files: StereoFiles,
    frames: FrameSelection,
    cameras: Cameras,
    wheels: WheelLog | None = None,
) -> StereoSequence:
    """Open the selected pairs of a recording; images are rectified on loading.

    Raises:
        DatasetError: If files are missing, none is readable, or their size is not the calibrated.
        CalibrationError: If the cameras are no stereo pair.
        SettingsError: If the selection is empty.
    """
    chosen = files.select(frames, folder)
    read = grey_reader((*chosen.left, *chosen.right), chosen.levels)
    left, right = cameras(*read.size_px)
    if read.size_px != (left.width_px, left.height_px):
        raise DatasetError(
            f"{chosen.left[0]}: the image is {read.size_px[0]}x{read.size_px[1]}, "
            f"{left.path} says {left.width_px}x{left.height_px}"
        )
    rig, remap_left, remap_right = rectify(left, right)

    def load(i: int) -> tuple[Image, Image]:
        return remap_left(read(chosen.left[i])), remap_right(read(chosen.right[i]))

    return StereoSequence(folder.resolve().name, rig, chosen.timestamps_ns, load, wheels)
