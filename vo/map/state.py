"""Where the camera has been: its last pose, its map, and the segment that was lost."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.map.frame import View
from vo.map.local_map import LocalMap, Sighting, empty_map
from vo.map.run_history import History
from vo.mapping.relocalization import find_again
from vo.tracking.appearance import PERSISTENT
from vo.tracking.association import Matches
from vo.tracking.stationary import Glimpse, Rest, glimpse, stands

PROVEN_VIEWS = 3
"""Frames that must have seen a landmark before its map is worth waiting for."""


@dataclass
class Journey:
    """The state that one frame hands to the next.

    Attributes:
        map: Keyframes and landmarks of the present segment; empty before its first frame.
        lost_map: Of a segment that nothing connects to the present one; None for none.
        history: For hindsight.
        T_odom_cam: (4, 4) pose of the last frame that had one.
        T_before_now: (4, 4) its motion, which predicts the next.
        spread: (6, 6) covariance of that pose, given the map.
        before: What the last frame with a pose saw; None before the first.
        strikes: Landmark to frames in a row with whose motion it disagreed.
        rest: The last frame that was somewhere else than the one before it; None before the first.
        last_ns: Its time.
        seen_ns: Time of the last frame, with or without a pose.
        lost_frames: Since the last pose.
        row_offsets_px: Of the last keyframes that could tell, how much lower the right eye shows
            what the left one does.
    """

    map: LocalMap = field(default_factory=empty_map)
    lost_map: LocalMap | None = None
    history: History = field(default_factory=History)
    T_odom_cam: Array = field(default_factory=lambda: np.eye(4))
    T_before_now: Array = field(default_factory=lambda: np.eye(4))
    spread: Array = field(default_factory=lambda: np.zeros((6, 6)))
    before: Sighting | None = None
    strikes: dict[int, int] = field(default_factory=dict[int, int])
    rest: Rest | None = None
    last_ns: int = 0
    seen_ns: int = -1
    lost_frames: int = 0
    row_offsets_px: deque[float] = field(default_factory=lambda: deque(maxlen=PERSISTENT))

    def advance(self, view: View, T_odom_cam: Array, spread: Array) -> Array:
        """Take over a pose and its covariance given the map.

        Returns:
            (6, 6) covariance of the step from the last pose.
        """
        T_now_before = se3.inverse(T_odom_cam) @ self.T_odom_cam
        step = se3.transform_covariance(T_now_before, self.spread) + spread
        self.T_before_now, self.T_odom_cam = se3.inverse(T_now_before), T_odom_cam
        self.spread, self.lost_frames, self.last_ns = spread, 0, view.frame.timestamp_ns
        keyframe = self.map.keyframes[-1]
        T_keyframe_cam = se3.inverse(keyframe.T_odom_cam) @ T_odom_cam
        self.history.place(self.last_ns, keyframe.serial, T_keyframe_cam)
        return step

    def note(self, view: View, inliers: Matches) -> None:
        """Count a view of the landmarks that agree with its pose."""
        self.map = self.map.seen(inliers.rows, inliers.features, view.vectors)
        self.before = Sighting(view.frame.left, inliers.ids, inliers.pixels)

    def wheels_rest(self, view: View) -> bool:
        """Whether encoders say that no wheel has turned since the camera last moved."""
        if view.settings.stationary != "encoders" or self.rest is None:
            return False
        return self.rest.wheel_ticks is not None and view.frame.wheel_ticks == self.rest.wheel_ticks

    def halt(self, view: View, inliers: Matches, rig: StereoRig) -> Rest | None:
        """Where the camera still stands (5.1.3, E11); None if it moves, or nobody asks."""
        standing = view.settings.stationary
        if self.rest is None or standing == "none":
            return None
        ticks = view.frame.wheel_ticks if standing == "encoders" else None
        seen = glimpse(inliers)
        if not stands(self.rest, seen, ticks, rig):
            return None
        self.rest = self.rest.joined(seen)
        return self.rest

    def leave(self, T_odom_cam: Array, spread: Array, view: View, seen: Glimpse) -> Rest:
        """Be at another pose, at which the camera may come to rest."""
        arrival = se3.log(se3.inverse(self.T_odom_cam) @ T_odom_cam)
        self.rest = Rest(T_odom_cam, arrival, spread, view.frame.wheel_ticks, (seen,))
        return self.rest

    def lose(self, patience: int) -> None:
        """Count a frame without a pose; when patience ends, the next view starts a new map.

        A map is waited for no longer than it has lasted, and not at all if hardly a frame saw it:
        it can only have been a false start.
        """
        self.lost_frames += 1
        self.T_before_now = np.eye(4)
        lasted = int(self.map.landmarks.views.max(initial=0))
        proven = lasted >= PROVEN_VIEWS
        if self.lost_frames > (min(patience, lasted) if proven else 0) and self.map.keyframes:
            if proven:
                self.lost_map = self.lost_map or self.map
            self.map = empty_map(self.map.next_serial, self.map.next_id)

    def covariance(self, T_odom_cam: Array, spread: Array) -> Array:
        """Covariance (6, 6) of a pose: that of the last keyframe, and its own given the map."""
        return _after(self.map, T_odom_cam, spread)

    def find_again(
        self, view: View, rig: StereoRig, settings: OdometrySettings, rng: np.random.Generator
    ) -> tuple[Array, Array] | None:
        """Pose and (6, 6) covariance of a view by the map of the segment that was lost."""
        if self.lost_map is None:
            return None
        found = find_again(self.lost_map, view, rig, settings, rng)
        if found is None:
            return None
        return found.T_world_cam, _after(self.lost_map, found.T_world_cam, found.covariance)

    def stitch(
        self, view: View, rig: StereoRig, settings: OdometrySettings, rng: np.random.Generator
    ) -> None:
        """Move this segment to where its last keyframe, the view, sees the one that was lost."""
        if found := self.find_again(view, rig, settings, rng):
            T_odom_cam, covariance = found
            T_new_old = T_odom_cam @ se3.inverse(self.map.keyframes[-1].T_odom_cam)
            self.history.move(self.map.keyframes[0].serial, T_new_old)
            self.map, self.lost_map = self.map.moved(T_new_old, covariance), None


def _after(local_map: LocalMap, T_odom_cam: Array, spread: Array) -> Array:
    keyframe = local_map.keyframes[-1]
    T_cam_keyframe = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
    return se3.transform_covariance(T_cam_keyframe, keyframe.covariance) + spread
