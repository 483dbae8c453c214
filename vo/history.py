"""What the map forgets, kept for the end: keyframes, the frames that hang on them, and points.

Refinement goes on moving a keyframe until it leaves the window. A frame in between was placed
relative to the last keyframe; put back onto where that ended, the whole trajectory profits from
what came later.
"""

from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array
from vo.contract.estimator import PointMap
from vo.contract.trajectory import Trajectory
from vo.tracks import LocalMap


@dataclass
class History:
    """Grows by a few numbers a frame and a few bytes a landmark; images are never kept."""

    keyframes: dict[int, Array] = field(default_factory=dict[int, Array])
    """Serial to the latest T_odom_cam."""
    frames: list[tuple[int, int, Array]] = field(default_factory=list[tuple[int, int, Array]])
    """Time, serial of the keyframe that a frame hangs on, and T_keyframe_cam."""
    _points: dict[int, tuple[Array, int, int]] = field(
        default_factory=dict[int, tuple[Array, int, int]]
    )
    """Landmark to its latest position, grey level and number of views."""

    def remember(self, local_map: LocalMap, least_views: int) -> None:
        """Take over the map's keyframes and those landmarks that enough frames saw."""
        for keyframe in local_map.keyframes:
            self.keyframes[keyframe.serial] = keyframe.T_odom_cam
        landmarks = local_map.landmarks
        grey = local_map.grey()
        for row in np.flatnonzero(landmarks.views >= least_views):
            self._points[int(landmarks.ids[row])] = (
                landmarks.points_odom[row].astype(np.float32),
                int(grey[row]),
                int(landmarks.views[row]),
            )

    def place(self, timestamp_ns: int, serial: int, T_keyframe_cam: Array) -> None:
        """Hang a frame on a keyframe."""
        self.frames.append((timestamp_ns, serial, T_keyframe_cam))

    def move(self, first: int, T_new_old: Array) -> None:
        """Carry the keyframes from a serial on by a rigid motion of the odometry frame."""
        for serial in self.keyframes:
            if serial >= first:
                self.keyframes[serial] = T_new_old @ self.keyframes[serial]

    @property
    def smoothed(self) -> Trajectory:
        """T_odom_cam of every frame that had a pose, by the last word on its keyframe."""
        times = np.array([time_ns for time_ns, _, _ in self.frames], dtype=np.int64)
        T = [self.keyframes[serial] @ T_keyframe_cam for _, serial, T_keyframe_cam in self.frames]
        return Trajectory(times, np.array(T).reshape(-1, 4, 4))

    @property
    def points(self) -> PointMap:
        """Every landmark that was ever remembered."""
        rows = list(self._points.values())
        return PointMap(
            np.array(list(self._points), dtype=np.int64),
            np.array([p for p, _, _ in rows], dtype=np.float32).reshape(-1, 3),
            np.array([g for _, g, _ in rows], dtype=np.uint8),
            np.array([v for _, _, v in rows], dtype=np.int64),
        )
