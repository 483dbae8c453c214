"""Worker of toy-vo, stereo flow and a window of keyframes, set up as its own example is."""

from typing import Any

import numpy as np
import toy_vo  # installed where this runs
from pipe import Image, Pose, Track, serve


def start(rig: dict[str, Any]) -> Track:
    """Return the tracker."""
    f, u, v = rig["f_px"], rig["cx_px"], rig["cy_px"]
    camera = (
        np.array([[f, 0, u], [0, f, v], [0, 0, 1.0]]), np.zeros(5), "OpenCVModel5",
        rig["width_px"], rig["height_px"],
    )  # fmt: skip
    t_right_left = np.array([-rig["baseline_m"], 0, 0])
    estimator = toy_vo.StereoEstimator(*camera, *camera, np.zeros(3), t_right_left)

    def track(t: float, left: Image, right: Image) -> tuple[Pose | None, str]:
        return np.array(estimator.process_frame(left, right)["T_w_cam0"], dtype=float), ""

    return track


if __name__ == "__main__":
    serve(start)
