"""Worker of OpenCV's RGB-D odometry."""

from typing import Any

import cv2  # with cv2.Odometry, as of version 5
import numpy as np
from chain import chained
from pipe import Image, Pose, Track, serve

DEPTH_UNITS = 5000.0
"""Depth units per metre: those of TUM RGB-D files, which OpenCV expects without documenting it."""
LEVELS = 4
"""Levels of the image pyramid."""


def start(rig: dict[str, Any]) -> Track:
    """Return the tracker."""
    f, u, v = rig["f_px"], rig["cx_px"], rig["cy_px"]
    chosen = cv2.OdometrySettings()
    chosen.setCameraMatrix(np.array([[f, 0, u], [0, f, v], [0, 0, 1]], np.float32))
    chosen.setMaxDepth(rig["max_depth_m"])
    gradients = np.full((LEVELS, 1), rig["min_gradient_grey"], np.float32)
    chosen.setMinGradientMagnitudes(gradients)
    kinds = {"rgb": cv2.OdometryType_RGB, "rgb_depth": cv2.OdometryType_RGB_DEPTH}
    odometry = cv2.Odometry(kinds[rig["method"]], chosen, cv2.OdometryAlgoType_COMMON)

    def prepare(left: Image, depth_m: Image) -> Any:
        frame = cv2.OdometryFrame((DEPTH_UNITS * depth_m).astype(np.float32), left)
        odometry.prepareFrame(frame)
        return frame

    def align(last: Any, now: Any) -> Pose | None:
        found, T_now_last = odometry.compute(last, now, np.eye(4))
        return np.asarray(T_now_last, dtype=float) if found else None

    return chained(prepare, align)


if __name__ == "__main__":
    serve(start, np.float64)
