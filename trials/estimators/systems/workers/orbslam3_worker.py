"""Worker of ORB-SLAM3, stereo; frames are passed at the rate of the recording.

Its own examples wait as well, because mapping threads need the time.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyorbslam3  # installed where this runs
from pipe import Image, Pose, Track, serve

CAMERA_YAML = """%YAML:1.0
Camera.type: "PinHole"
Camera.fx: {f_px:f}
Camera.fy: {f_px:f}
Camera.cx: {cx_px:f}
Camera.cy: {cy_px:f}
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: {width_px}
Camera.height: {height_px}
Camera.fps: {rate_hz:f}
Camera.bf: {bf:f}
Camera.RGB: 1
ThDepth: {far_point_baselines:f}
ORBextractor.nFeatures: {features}
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""


def start(rig: dict[str, Any]) -> Track:
    """Load the vocabulary and return the tracker."""
    with tempfile.TemporaryDirectory() as folder:
        sheet = Path(folder) / "camera.yaml"
        sheet.write_text(CAMERA_YAML.format(bf=rig["f_px"] * rig["baseline_m"], **rig))
        slam = pyorbslam3.Slam(rig["vocabulary"], str(sheet), pyorbslam3.Sensor.STEREO, False)
    first: list[tuple[float, float]] = []  # time in the recording, time of the clock

    def track(t: float, left: Image, right: Image) -> tuple[Pose | None, str]:
        if rate := rig["playback_rate"]:
            if not first:
                first.append((t, time.perf_counter()))
            early = (t - first[0][0]) / rate - (time.perf_counter() - first[0][1])
            time.sleep(max(early, 0))
        result = slam.track_stereo(left, right, t)
        good = result.state == pyorbslam3.TrackingState.OK
        pose = np.array(result.pose_wc, dtype=float) if good else None
        return pose, result.state.name.lower().replace("_", " ")

    return track


if __name__ == "__main__":
    serve(start)
