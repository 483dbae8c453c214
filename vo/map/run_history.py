"""Record of a whole run, for the smoothed trajectory and the map at its end.

Bundle adjustment moves a keyframe until it leaves the window. Every other frame is kept relative
to its keyframe, so that the trajectory profits from later corrections.
"""

import itertools
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.estimator import PointMap
from vo.contract.observations import Observations
from vo.contract.trajectory import Trajectory
from vo.map.local_map import Landmarks, LocalMap


class KeyframeRecord(NamedTuple):
    """Latest pose (4, 4) and, for full-batch adjustment, observations in single precision."""

    T_odom_cam: Array
    observations: Observations | None


@dataclass
class RunHistory:
    """Grows by a few numbers a frame and a few bytes a landmark; images are never kept.

    Keyframes are by serial. Of each frame that had a pose there is the time, the serial of its
    keyframe and T_keyframe_cam. Landmarks are by identifier, in rows that are without meaning
    where there are no views: the latest position (N, 3) in metres, and (N,) number of views, serial
    of the anchor and grey level.
    """

    keyframes: dict[int, KeyframeRecord] = field(default_factory=dict[int, KeyframeRecord])
    frames: list[tuple[int, int, Array]] = field(default_factory=list[tuple[int, int, Array]])
    points: Array = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    views: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    anchor: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    grey: Array = field(default_factory=lambda: np.zeros(0, np.uint8))

    def record_keyframe(self, time_ns: int, serial: int) -> None:
        """Let a recent frame be a keyframe; later ones stay relative to the one before."""
        i = next(i for i in reversed(range(len(self.frames))) if self.frames[i][0] == time_ns)
        self.frames[i] = (time_ns, serial, np.eye(4))

    def record_map(self, local_map: LocalMap, settings: RefinementSettings) -> None:
        """Update the map's keyframes, and its landmarks with enough views."""
        for keyframe in local_map.keyframes:
            known = self.keyframes.get(keyframe.serial)
            observations = known.observations if known else None
            if settings.smooth == "global" and keyframe is local_map.keyframes[-1]:
                seen = keyframe.observations
                measured, sigma_px = (
                    x.astype(np.float32) for x in (seen.at_instant, seen.sigma_px)
                )
                observations = Observations(
                    seen.ids, measured[:, :2], measured[:, 2], sigma_px=sigma_px
                )
            self.keyframes[keyframe.serial] = KeyframeRecord(keyframe.T_odom_cam, observations)
        often = local_map.landmarks.views >= settings.min_views
        self.record_landmarks(local_map.landmarks.select(often), local_map.grey()[often])

    def record_landmarks(self, landmarks: Landmarks, grey: Array) -> None:
        """Update landmarks (N,), whose grey levels (N,) are given."""
        ids = landmarks.ids
        missing = int(ids.max(initial=-1)) + 1 - len(self.views)
        if missing > 0:
            room = missing + len(self.views)  # doubled: copies are rare
            for name, column in self._columns().items():
                more = np.zeros((room, *column.shape[1:]), column.dtype)
                setattr(self, name, np.concatenate([column, more]))
        self.points[ids], self.grey[ids] = landmarks.points_odom, grey
        self.views[ids], self.anchor[ids] = landmarks.views, landmarks.anchor

    def _columns(self) -> dict[str, Array]:
        return {name: getattr(self, name) for name in ("points", "views", "anchor", "grey")}

    def velocity(self, time_ns: int) -> Array | None:
        """Velocity (6,), m/s and rad/s, in the camera's frame, by the frames before and after one.

        None if the frame is not between two with poses.
        """
        i = next((i for i in reversed(range(len(self.frames))) if self.frames[i][0] == time_ns), 0)
        if not 0 < i < len(self.frames) - 1:
            return None
        near = self.frames[i - 1 : i + 2]
        T = [self.keyframes[serial].T_odom_cam @ T for _, serial, T in near]
        before_s, after_s = np.diff([1e-9 * time for time, _, _ in near])
        before, after = se3.log(np.array([se3.inverse(a) @ b for a, b in itertools.pairwise(T)]))
        share = after_s / (before_s + after_s)
        return share * before / before_s + (1 - share) * after / after_s

    def transform(self, first: int, T_new_old: Array) -> None:
        """Transform keyframes from a serial on, and their landmarks, by a rigid motion of odom."""
        for serial, keyframe in self.keyframes.items():
            if serial >= first:
                moved = keyframe._replace(T_odom_cam=T_new_old @ keyframe.T_odom_cam)
                self.keyframes[serial] = moved
        theirs = (self.views > 0) & (self.anchor >= first)
        self.points[theirs] = se3.transform(T_new_old, self.points[theirs])

    @property
    def ids(self) -> Indices:
        """Landmarks (N,), ascending."""
        return np.flatnonzero(self.views)

    def positions(self, ids: Indices) -> Array:
        """Positions (N, 3) of landmarks (N,), metres."""
        return self.points[ids].astype(np.float64)

    @property
    def trajectory(self) -> Trajectory:
        """T_odom_cam of every frame that had a pose, by the latest pose of its keyframe."""
        times = np.array([time_ns for time_ns, _, _ in self.frames], dtype=np.int64)
        T = [self.keyframes[serial].T_odom_cam @ T for _, serial, T in self.frames]
        return Trajectory(times, np.array(T).reshape(-1, 4, 4))

    @property
    def point_map(self) -> PointMap:
        """Every recorded landmark."""
        ids = self.ids
        views = self.views[ids].astype(np.int64)
        return PointMap(ids, self.points[ids], self.grey[ids], views)
