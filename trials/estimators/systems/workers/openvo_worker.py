"""Worker of openVO, set up as its own example is; semi-global matching as in the other systems."""

from typing import Any

import cv2
import numpy as np
from openVO import StereoCamera, StereoOdometer  # installed where this runs
from pipe import Image, Pose, Track, serve

SGBM = {
    "minDisparity": 0, "numDisparities": 128, "blockSize": 5, "P1": 8 * 25, "P2": 32 * 25,
    "disp12MaxDiff": 1, "preFilterCap": 0, "uniquenessRatio": 8, "speckleWindowSize": 0,
    "speckleRange": 0,
}  # fmt: skip


def start(rig: dict[str, Any]) -> Track:
    """Return the tracker."""
    f, u, v = rig["f_px"], rig["cx_px"], rig["cy_px"]
    K, undistorted = np.array([[f, 0, u], [0, f, v], [0, 0, 1.0]]), np.zeros(5)
    relation = {"R": np.eye(3), "T": np.array([-rig["baseline_m"], 0.0, 0.0])}
    size = (rig["width_px"], rig["height_px"])
    camera = StereoCamera(K, undistorted, K, undistorted, relation, SGBM, size)
    odometer = StereoOdometer(
        camera, nfeatures=1000, match_threshold=0.9, rigidity_threshold=0.06, outlier_threshold=0.1
    )
    cv2.setRNGSeed(rig["seed"])

    def track(t: float, left: Image, right: Image) -> tuple[Pose | None, str]:
        if not odometer.update(left, right):
            return None, odometer.skip_cause or "skipped"
        return odometer.current_pose(), ""

    return track


if __name__ == "__main__":
    serve(start)
