"""What the map forgets, kept for the end: keyframes, the frames that hang on them, and points.

Refinement goes on moving a keyframe until it leaves the window. A frame in between was placed
relative to the last keyframe; put back onto where that ended, the whole trajectory profits from
what came later.
"""

from dataclasses import dataclass, field

import numpy as np

from vo.bundle_adjustment.problem import Sight
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.estimator import PointMap
from vo.contract.trajectory import Trajectory
from vo.map.local_map import LocalMap


@dataclass
class History:
    """Grows by a few numbers a frame and a few bytes a landmark; images are never kept.

    Attributes:
        keyframes: Serial to the latest T_odom_cam.
        frames: Time, serial of the keyframe that a frame hangs on, and T_keyframe_cam.
        places: Landmark to its latest position (3,), metres.
        traits: Landmark to its grey level, its number of views, and its anchor's serial.
        sights: Serial to what the keyframe saw, in single precision; only where everything is
            refined in the end.
    """

    keyframes: dict[int, Array] = field(default_factory=dict[int, Array])
    frames: list[tuple[int, int, Array]] = field(default_factory=list[tuple[int, int, Array]])
    places: dict[int, Array] = field(default_factory=dict[int, Array])
    traits: dict[int, tuple[int, int, int]] = field(default_factory=dict[int, tuple[int, int, int]])
    sights: dict[int, Sight] = field(default_factory=dict[int, Sight])

    def remember(self, local_map: LocalMap, settings: RefinementSettings) -> None:
        """Take over the map's keyframes and those landmarks that enough frames saw."""
        for keyframe in local_map.keyframes:
            self.keyframes[keyframe.serial] = keyframe.T_odom_cam
        if settings.smooth == "global":
            newest = local_map.keyframes[-1]
            self.sights[newest.serial] = Sight(
                newest.T_odom_cam,
                newest.ids,
                newest.measured.astype(np.float32),
                newest.sigma.astype(np.float32),
            )
        landmarks = local_map.landmarks
        often = landmarks.views >= settings.min_views
        ids = landmarks.ids[often].tolist()
        traits = (local_map.grey(), landmarks.views, landmarks.anchor)
        self.places.update(zip(ids, landmarks.points_odom[often].astype(np.float32), strict=True))
        self.traits.update(
            zip(ids, zip(*(x[often].tolist() for x in traits), strict=True), strict=True)
        )

    def place(self, timestamp_ns: int, serial: int, T_keyframe_cam: Array) -> None:
        """Hang a frame on a keyframe."""
        self.frames.append((timestamp_ns, serial, T_keyframe_cam))

    def move(self, first: int, T_new_old: Array) -> None:
        """Carry keyframes from a serial on, and their points, by a motion of the odometry frame."""
        for serial in self.keyframes:
            if serial >= first:
                self.keyframes[serial] = T_new_old @ self.keyframes[serial]
        for landmark, (_, _, anchor) in self.traits.items():
            if anchor >= first:
                moved = se3.transform(T_new_old, self.places[landmark][None])[0]
                self.places[landmark] = moved.astype(np.float32)

    def positions(self, ids: Indices) -> Array:
        """Where landmarks (N,) are: (N, 3) metres."""
        places = [self.places[int(landmark)] for landmark in ids]
        return np.array(places, dtype=np.float64).reshape(-1, 3)

    @property
    def smoothed(self) -> Trajectory:
        """T_odom_cam of every frame that had a pose, by the last word on its keyframe."""
        times = np.array([time_ns for time_ns, _, _ in self.frames], dtype=np.int64)
        T = [self.keyframes[serial] @ T_keyframe_cam for _, serial, T_keyframe_cam in self.frames]
        return Trajectory(times, np.array(T).reshape(-1, 4, 4))

    @property
    def points(self) -> PointMap:
        """Every landmark that was ever remembered."""
        ids = np.array(list(self.places), dtype=np.int64)
        traits = np.array([self.traits[int(i)] for i in ids], dtype=np.int64).reshape(-1, 3)
        return PointMap(
            ids, self.positions(ids).astype(np.float32), traits[:, 0].astype(np.uint8), traits[:, 1]
        )
