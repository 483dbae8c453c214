"""File formats of the dense labels."""

from pathlib import Path
from typing import NamedTuple

from vo.contract.arrays import Array
from vo.recordings.images import read_codes, read_float

FLOAT, CODES = "32-bit float TIFF, lossless", "PNG"
FLOAT_3 = "3-channel 32-bit float TIFF, lossless; channels as listed, which OpenCV reverses"
SEEN = (
    "0 visible, 1 hidden behind something, 2 out of the picture, 3 no surface here, 4 an outline "
    "within a pixel hides it or not"
)


class LabelFormat(NamedTuple):
    """File format of a dense label, and what a pixel means.

    The last digit of the folder under mav0 is the camera whose pixels it labels.
    """

    folder: str
    about: str
    unit: str
    encoding: str = FLOAT
    invalid: str = "nan"

    @property
    def suffix(self) -> str:
        """File name suffix."""
        return ".png" if self.encoding == CODES else ".tiff"


LABELS = {
    "depth": LabelFormat("depth0", "distance along the optical axis, at pixel centres", "m"),
    "disparity": LabelFormat(
        "disparity0", "u_left - u_right of left pixels: f * baseline / depth", "px"
    ),
    "disparity_right": LabelFormat("disparity1", "u_left - u_right of right pixels", "px"),
    "occlusion": LabelFormat(
        "occlusion0", f"whether the right camera sees a left pixel: {SEEN}", "code", CODES, "3"
    ),
    "flow": LabelFormat(
        "flow0",
        "where a pixel's point is in the next left image: du, dv in pixels, then its depth there "
        "in metres; absent for the last frame",
        "px, px, m",
        FLOAT_3,
        "nan; the depth of the sky is nan, its motion is not",
    ),
    "covisibility": LabelFormat(
        "covisibility0",
        f"whether the next left image shows a pixel's point: {SEEN}; absent for the last frame",
        "code",
        CODES,
        "3",
    ),
    "segmentation": LabelFormat(
        "segmentation0", "object; the manifest's `things` has the names", "id", CODES, "0"
    ),
    "classes": LabelFormat(
        "classes0", "0 sky, 1 ground, 2 static, 3 moving", "code", CODES, "none"
    ),
    "normals": LabelFormat(
        "normals0",
        "unit normal of the surface towards the camera, in camera axes; nan where neighbouring "
        "pixels share no plane",
        "1",
        FLOAT_3,
    ),
    "raw_depth": LabelFormat(
        "raw_depth0", "distance along the ray, at pixel centres of the raw image", "m"
    ),
    "raw_flow": LabelFormat(
        "raw_flow0",
        "where a raw pixel's point is in the next left raw image: du, dv in pixels, then its "
        "distance there in metres; absent for the last frame",
        "px, px, m",
        FLOAT_3,
        "nan; the distance of the sky is nan, its motion is not",
    ),
    "raw_segmentation": LabelFormat(
        "raw_segmentation0",
        "object of a raw pixel, as segmentation0",
        "id",
        CODES,
        "0",
    ),
}


FORWARD = frozenset({"flow", "covisibility", "raw_flow"})
"""Labels that need the next frame."""


def read_label(folder: Path, label: str, time_ns: int) -> Array:
    """Read one of LABELS of a dataset folder: (H, W) codes or float32, or (H, W, 3) float32.

    Raises:
        ImageError: If the file is missing, damaged or of another kind.
    """
    file, encoding = label_file(folder, label, time_ns), LABELS[label].encoding
    if encoding == CODES:
        return read_codes(file)
    return read_float(file, 3 if encoding == FLOAT_3 else 1)


def label_file(folder: Path, label: str, time_ns: int) -> Path:
    """Return the path of one of LABELS in a dataset folder."""
    form = LABELS[label]
    return folder / "mav0" / form.folder / "data" / f"{time_ns}{form.suffix}"
