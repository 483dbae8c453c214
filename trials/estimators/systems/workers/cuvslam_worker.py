"""Worker of cuVSLAM, stereo, through dim-odom."""

from typing import Any

import dim_odom  # installed where this runs
import numpy as np
from pipe import Image, Pose, Track, serve

LEFT, RIGHT = "left", "right"
Transform = tuple[tuple[float, float, float], tuple[float, float, float, float]]


def start(rig: dict[str, Any]) -> Track:
    """Return the tracker; frames are rigid with respect to each other, in axes of the cameras."""
    places = {LEFT: 0.0, RIGHT: rig["baseline_m"]}

    def transform(parent: str, child: str) -> Transform | None:
        if parent not in places or child not in places:
            return None
        return (places[child] - places[parent], 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)

    config = {
        "camera_mode": "stereo",
        "use_gpu": rig["use_gpu"],
        "cameras": [{"frame_id": x, "rectified": True} for x in (LEFT, RIGHT)],
        "rig_frame_id": LEFT,
        "output_frame_id": LEFT,
        "odom_frame_id": "odom",
    }
    tracker = dim_odom.CuvslamOdometry(config, tf=transform)
    f, width, height = rig["f_px"], rig["width_px"], rig["height_px"]
    K = [f, 0.0, rig["cx_px"], 0.0, f, rig["cy_px"], 0.0, 0.0, 1.0]
    for name in (LEFT, RIGHT):
        tracker.handle_camera_info(dim_odom.CameraModel(0, name, width, height, [0.0] * 5, K))
    first: list[Pose] = []

    def track(t: float, left: Image, right: Image) -> tuple[Pose | None, str]:
        found = None
        for name, image in ((LEFT, left), (RIGHT, right)):
            made = dim_odom.ImageFrame(
                round(t * 1e9), name, width, height, "mono8", width, image.tobytes()
            )
            found = tracker.handle_image(made) or found
        if found is None:
            return None, "not tracked"
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = _rotation(*found.rotation_xyzw), found.translation
        first.append(T)
        del first[1:]
        return np.linalg.inv(first[0]) @ T, ""

    return track


def _rotation(x: float, y: float, z: float, w: float) -> Pose:
    """Return the rotation matrix (3, 3) of a unit quaternion."""
    v = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross


if __name__ == "__main__":
    serve(start)
