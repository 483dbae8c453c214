"""Record of a whole run, for the smoothed trajectory and the map at its end.

Bundle adjustment moves a keyframe until it leaves the window. Every other frame is kept relative
to its keyframe, so that the trajectory profits from later corrections.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.estimator import PointMap
from vo.contract.observations import Observations
from vo.contract.trajectory import Trajectory
from vo.map.local_map import LocalMap


class KeyframeRecord(NamedTuple):
    """Latest pose (4, 4) and, for full-batch adjustment, observations in single precision."""

    T_odom_cam: Array
    observations: Observations | None


class LandmarkRecord(NamedTuple):
    """Grey level, number of views and serial of the anchor of a landmark."""

    grey: int
    views: int
    anchor: int


@dataclass
class RunHistory:
    """Grows by a few numbers a frame and a few bytes a landmark; images are never kept.

    Keyframes are by serial. Of each frame that had a pose there is the time, the serial of its
    keyframe and T_keyframe_cam; of each landmark the latest position (3,) in metres.
    """

    keyframes: dict[int, KeyframeRecord] = field(default_factory=dict[int, KeyframeRecord])
    frames: list[tuple[int, int, Array]] = field(default_factory=list[tuple[int, int, Array]])
    points: dict[int, Array] = field(default_factory=dict[int, Array])
    landmarks: dict[int, LandmarkRecord] = field(default_factory=dict[int, LandmarkRecord])

    def record_map(self, local_map: LocalMap, settings: RefinementSettings) -> None:
        """Update the map's keyframes, and its landmarks with enough views."""
        for keyframe in local_map.keyframes:
            known = self.keyframes.get(keyframe.serial)
            observations = known.observations if known else None
            if settings.smooth == "global" and keyframe is local_map.keyframes[-1]:
                seen = keyframe.observations
                measured = (seen.pixels, seen.disparity_px, seen.sigma_px)
                pixels, disparity_px, sigma_px = (x.astype(np.float32) for x in measured)
                observations = Observations(seen.ids, pixels, disparity_px, sigma_px=sigma_px)
            self.keyframes[keyframe.serial] = KeyframeRecord(keyframe.T_odom_cam, observations)
        landmarks = local_map.landmarks
        often = landmarks.views >= settings.min_views
        ids = landmarks.ids[often].tolist()
        columns = (local_map.grey(), landmarks.views, landmarks.anchor)
        self.points.update(zip(ids, landmarks.points_odom[often].astype(np.float32), strict=True))
        records = map(LandmarkRecord, *(x[often].tolist() for x in columns))
        self.landmarks.update(zip(ids, records, strict=True))

    def transform(self, first: int, T_new_old: Array) -> None:
        """Transform keyframes from a serial on, and their landmarks, by a rigid motion of odom."""
        for serial, keyframe in self.keyframes.items():
            if serial >= first:
                moved = keyframe._replace(T_odom_cam=T_new_old @ keyframe.T_odom_cam)
                self.keyframes[serial] = moved
        for landmark, record in self.landmarks.items():
            if record.anchor >= first:
                moved = se3.transform(T_new_old, self.points[landmark][None])[0]
                self.points[landmark] = moved.astype(np.float32)

    def positions(self, ids: Indices) -> Array:
        """Positions (N, 3) of landmarks (N,), metres."""
        points = [self.points[int(landmark)] for landmark in ids]
        return np.array(points, dtype=np.float64).reshape(-1, 3)

    @property
    def trajectory(self) -> Trajectory:
        """T_odom_cam of every frame that had a pose, by the latest pose of its keyframe."""
        times = np.array([time_ns for time_ns, _, _ in self.frames], dtype=np.int64)
        T = [self.keyframes[serial].T_odom_cam @ T for _, serial, T in self.frames]
        return Trajectory(times, np.array(T).reshape(-1, 4, 4))

    @property
    def point_map(self) -> PointMap:
        """Every recorded landmark."""
        ids = np.array(list(self.points), dtype=np.int64)
        records = np.array([self.landmarks[int(i)] for i in ids], dtype=np.int64).reshape(-1, 3)
        grey, views, _ = records.T
        return PointMap(ids, self.positions(ids).astype(np.float32), grey.astype(np.uint8), views)
