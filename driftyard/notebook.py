"""What notebooks show and take: thumbnails and tables of pandas."""

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from vo.contract.errors import DriftyardError
from vo.contract.sequence import StereoFrame

if TYPE_CHECKING:
    import pandas as pd

WIDTH_PX = 480
"""Width of both images together."""


def thumbnails(frame: StereoFrame) -> str:
    """Return the two images of a frame side by side as an HTML element."""
    both = np.hstack([frame.left, frame.right])
    scale = min(1.0, WIDTH_PX / both.shape[1])
    small = cv2.resize(both, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    png = base64.b64encode(cv2.imencode(".png", small)[1].tobytes()).decode("ascii")
    return f"<img alt='left and right image of frame 0' src='data:image/png;base64,{png}'>"


def data_frame(columns: Mapping[str, Any]) -> "pd.DataFrame":
    """Make a table of columns by name.

    Raises:
        DriftyardError: If pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise DriftyardError("pandas is not installed; pip install pandas") from None
    return pd.DataFrame(dict(columns))
