"""What notebooks show and take: thumbnails and tables of pandas."""

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from sim.dataset.image_codecs import encode_png
from trials.evaluation.display import import_pandas
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.sequence import StereoFrame

if TYPE_CHECKING:
    import pandas as pd

WIDTH_PX = 300
"""Largest width of each image."""


def thumbnails(frame: StereoFrame) -> str:
    """Return the two images of a frame as HTML elements, beside each other where there is room."""
    return "".join(
        f"<img alt='{eye} image of frame 0' style='margin: 0 4px 4px 0; max-width: 100%' "
        f"src='data:image/png;base64,{_thumbnail(image)}'>"
        for eye, image in (("left", frame.left), ("right", frame.right))
    )


def _thumbnail(image: Image) -> str:
    """Return a small image as PNG in base 64."""
    scale = min(1.0, WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return base64.b64encode(encode_png(np.asarray(small))).decode("ascii")


def pose_columns(T: Array) -> dict[str, Array]:
    """Return position, metres, and quaternion of poses (N, 4, 4) as columns; NaN where they are."""
    known = np.isfinite(T).all(axis=(1, 2))
    quat_wxyz = np.full((len(T), 4), np.nan)
    quat_wxyz[known] = se3.to_quat_wxyz(T[known])
    columns = {f"{axis}_m": T[:, k, 3] for k, axis in enumerate("xyz")}
    return columns | {f"q{axis}": quat_wxyz[:, k] for k, axis in enumerate("wxyz")}


def data_frame(columns: Mapping[str, Any]) -> "pd.DataFrame":
    """Make a table of columns by name.

    Raises:
        DriftyardError: If pandas is not installed.
    """
    return import_pandas().DataFrame(dict(columns))
