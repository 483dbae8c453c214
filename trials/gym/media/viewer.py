"""A window that shows images of a trial, where there is a display."""

import os
import sys

import cv2
import numpy as np

from vo.contract.arrays import Image
from vo.contract.errors import SettingsError

TITLE = "driftyard"


def render_modes() -> list[str]:
    """List the render modes that this machine supports."""
    return ["rgb_array"] if _missing() else ["human", "rgb_array"]


class Viewer:
    """A window of OpenCV."""

    @staticmethod
    def check() -> None:
        """Refuse where no window can be shown.

        Raises:
            SettingsError: Names what is missing.
        """
        if missing := _missing():
            raise SettingsError(f"render_mode human: {missing}; rgb_array needs neither")

    def show(self, image: Image) -> None:
        """Show (H, W, 3) RGB."""
        cv2.imshow(TITLE, np.ascontiguousarray(image[..., ::-1]))
        cv2.waitKey(1)

    def close(self) -> None:
        """Close the window."""
        cv2.destroyWindow(TITLE)


def _missing() -> str:
    """What a window needs and this machine lacks; empty if nothing."""
    has_display = sys.platform != "linux" or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if not has_display:
        return "there is no display"
    information = cv2.getBuildInformation()
    gui = next((x for x in information.splitlines() if x.strip().startswith("GUI:")), "GUI: NONE")
    if gui.split(":")[1].strip() == "NONE":
        return "this OpenCV has no windows (pip install opencv-python in its place)"
    return ""
