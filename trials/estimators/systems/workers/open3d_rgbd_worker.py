"""Worker of Open3D's RGB-D odometry."""

from typing import Any

import numpy as np
import open3d as o3d  # installed where this runs
from chain import chained
from pipe import Image, Pose, Track, serve

ODOMETRY = o3d.t.pipelines.odometry
METHODS = {
    "hybrid": ODOMETRY.Method.Hybrid,
    "intensity": ODOMETRY.Method.Intensity,
    "point_to_plane": ODOMETRY.Method.PointToPlane,
}


def start(rig: dict[str, Any]) -> Track:
    """Return the tracker."""
    f, u, v = rig["f_px"], rig["cx_px"], rig["cy_px"]
    K = o3d.core.Tensor(np.array([[f, 0, u], [0, f, v], [0, 0, 1.0]]))

    def prepare(left: Image, depth_m: Image) -> Any:
        colour = np.repeat(left[:, :, None], 3, axis=2).astype(np.float32) / 255
        depth = np.nan_to_num(depth_m).astype(np.float32)[:, :, None]
        return o3d.t.geometry.RGBDImage(
            o3d.t.geometry.Image(o3d.core.Tensor(colour)),
            o3d.t.geometry.Image(o3d.core.Tensor(depth)),
        )

    def align(last: Any, now: Any) -> Pose | None:
        try:
            found = ODOMETRY.rgbd_odometry_multi_scale(
                last, now, K, depth_scale=1.0, depth_max=rig["max_depth_m"],
                method=METHODS[rig["method"]],
            )  # fmt: skip
        except RuntimeError:  # of a singular system of equations
            return None
        return found.transformation.numpy() if found.fitness > 0 else None

    return chained(prepare, align)


if __name__ == "__main__":
    serve(start, np.float64)
