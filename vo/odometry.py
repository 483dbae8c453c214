"""The algorithm: stereo frames in, one pose and one status per frame out (thesis, algorithm 2)."""

import numpy as np

from vo.appearance import explain_failure, eyes_look_swapped
from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, Hindsight, Observations, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.correspondence import Matches, find_matches, find_more
from vo.history import History
from vo.localisation import agreeing, orient, refine_pose
from vo.mapping import add_keyframe, is_new_view, refine_map
from vo.recovery import ADRIFT, find_again
from vo.refine import Pose
from vo.stereo import DenseStereo
from vo.tracks import LocalMap, empty_map
from vo.view import View, look

ONE_EYED = 0.7
"""Share of inliers without disparity above which the right image shows something else."""


class StereoOdometry:
    """CenSurE, ZNCC marriage, P3P under RANSAC, and bundle adjustment over a window."""

    def __init__(self, rig: StereoRig, settings: OdometrySettings | None = None) -> None:
        self.rig = rig
        self.settings = settings or OdometrySettings()
        self._dense_stereo = DenseStereo(self.settings.stereo)
        self._rng = np.random.default_rng(self.settings.seed)
        self._map = empty_map()
        self._history = History()
        self._lost_map: LocalMap | None = None  # of a segment that nothing connects to this one
        self._T_odom_cam = np.eye(4)  # of the last frame that had a pose
        self._T_before_now = np.eye(4)  # its motion, which predicts the next
        self._spread = np.zeros((6, 6))  # its covariance, given the map
        self._smoothing_px = 0.0
        self._lost_frames = 0

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        s, clock = self.settings, Clock()
        view = look(frame, self._dense_stereo, s, clock, self._smoothing_px)  # CenSurE (3.2)
        counts = {"features": len(view.features), "matches": 0, "inliers": 0}
        if not self._map.keyframes:
            return self._start(view, counts, clock)

        for T_guess, reach_px in self._guesses():
            located = self._locate(view, T_guess, reach_px, counts, clock)
            if located:
                break
        else:
            return self._lose(view, counts, clock)
        pose, matches, inliers = located
        T_odom_cam = pose.T_world_cam
        if np.isnan(inliers.measured[:, 2]).mean() > ONE_EYED and eyes_look_swapped(view, s):
            return self._lose(view, counts, clock)

        with clock("structure refinement"):  # motion and structure, on long tracks (3.4, 4.4)
            self._map = self._map.seen(inliers.rows, inliers.features, view.vectors)
            if is_new_view(self._map.keyframes[-1], inliers, s.refinement):
                covariance = self._covariance(T_odom_cam, pose.covariance)
                self._map = add_keyframe(
                    self._map, view, T_odom_cam, covariance, inliers, self.rig, s
                )
                self._map, counts["structure iterations"] = refine_map(self._map, self.rig, s)
                self._stitch(view)
                self._history.remember(self._map, s.refinement.least_views)
                if self._map.depth_share < s.features.clear_share:
                    self._smoothing_px = s.features.smoothing_px
                T_odom_cam = self._map.keyframes[-1].T_odom_cam

        weak = len(inliers) < s.motion.weak_inliers
        status = Status.WEAK if weak else Status.TRACKED
        reason = f"{len(inliers)} inliers, fewer than {s.motion.weak_inliers}" if weak else ""
        seen = Observations(
            matches.ids, matches.pixels, matches.measured[:, 2], np.isin(matches.ids, inliers.ids)
        )
        step = self._advance(view, T_odom_cam, pose.covariance)
        covariance = self._covariance(T_odom_cam, pose.covariance)
        return Estimate(
            frame.timestamp_ns, status, T_odom_cam, reason, counts, clock.ms, seen, covariance, step
        )

    def reflect(self) -> Hindsight:
        """Return the trajectory by the last refinement of every keyframe, and the map."""
        return Hindsight(self._history.smoothed, self._history.points)

    def _locate(
        self, view: View, T_guess: Array, reach_px: float, counts: dict[str, int], clock: Clock
    ) -> tuple[Pose, Matches, Matches] | None:
        """Match about a guess and estimate the pose: with it all matches, and the inliers."""
        s, rig = self.settings, self.rig
        with clock("matching"):  # marriage by ZNCC, sub-pixel alignment (3.2)
            matches = find_matches(self._map, view, T_guess, reach_px, rig, s)
            counts["matches"] = len(matches)
        with clock("motion"):  # orientation under RANSAC (3.3)
            consensus = orient(matches, rig, s.motion, self._rng)
            if consensus is None or consensus.inliers.sum() < s.motion.least_inliers:
                return None
        with clock("motion refinement"):  # at every frame (3.4)
            pose = refine_pose(consensus.T, matches.select(consensus.inliers), rig, s)
        if s.matching.guided:
            with clock("guided matching"):  # the other landmarks, where the pose puts them (F5)
                matches = find_more(self._map, view, pose.T_world_cam, matches, rig, s)
                agreed = agreeing(pose.T_world_cam, matches, rig, s.motion)
                pose = refine_pose(pose.T_world_cam, agreed, rig, s)
        inliers = agreeing(pose.T_world_cam, matches, rig, s.motion)
        counts["found"], counts["inliers"] = len(matches), len(inliers)
        counts["motion iterations"] = pose.iterations
        return (pose, matches, inliers) if len(inliers) >= s.motion.least_inliers else None

    def _guesses(self) -> tuple[tuple[Array, float], tuple[Array, float]]:
        """Predicted poses and how far to search about them: the expected motion, then any."""
        s = self.settings.matching
        motion = self._T_before_now if s.predict == "steady" else np.eye(4)
        return (self._T_odom_cam @ motion, s.search_px), (self._T_odom_cam, s.widest_search_px)

    def _advance(self, view: View, T_odom_cam: Array, spread: Array) -> Array:
        """Take over a pose; returns the (6, 6) covariance of the step from the last one."""
        T_now_before = se3.inverse(T_odom_cam) @ self._T_odom_cam
        step = se3.carry_covariance(T_now_before, self._spread) + spread
        self._T_before_now, self._T_odom_cam = se3.inverse(T_now_before), T_odom_cam
        self._spread, self._lost_frames = spread, 0
        keyframe = self._map.keyframes[-1]
        T_keyframe_cam = se3.inverse(keyframe.T_odom_cam) @ T_odom_cam
        self._history.place(view.frame.timestamp_ns, keyframe.serial, T_keyframe_cam)
        return step

    def _covariance(self, T_odom_cam: Array, spread: Array) -> Array:
        """Covariance of a pose: that of the last keyframe, and its own given the map."""
        keyframe = self._map.keyframes[-1]
        T_cam_keyframe = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
        return se3.carry_covariance(T_cam_keyframe, keyframe.covariance) + spread

    def _start(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Begin a map at the last known pose, if the view shows enough points with depth."""
        time, s = view.frame.timestamp_ns, self.settings
        T_odom_cam, covariance = self._T_odom_cam, np.zeros((6, 6))
        if self._lost_frames:
            T_odom_cam, covariance = self._find_again(view) or (T_odom_cam, ADRIFT * np.eye(6))
        fresh = add_keyframe(self._map, view, T_odom_cam, covariance, None, self.rig, s)
        if fresh.depth_share < s.features.clear_share and not self._smoothing_px:
            self._smoothing_px = s.features.smoothing_px
            view = look(view.frame, self._dense_stereo, s, clock, self._smoothing_px)
            fresh = add_keyframe(self._map, view, T_odom_cam, covariance, None, self.rig, s)
        counts["fresh"] = len(fresh.landmarks)
        if len(fresh.landmarks) < s.motion.least_inliers:
            self._lost_frames += 1
            reason = explain_failure(view, s) or (
                f"{len(fresh.landmarks)} features with depth, need {s.motion.least_inliers}"
            )
            return Estimate(time, Status.LOST, None, reason, counts, clock.ms)
        reason = f"new segment after {self._lost_frames} lost frames" if self._lost_frames else ""
        self._map = fresh
        self._history.remember(fresh, s.refinement.least_views)
        if covariance[0, 0] < ADRIFT:
            self._lost_map = None
        step = self._advance(view, T_odom_cam, np.zeros((6, 6))) + covariance
        return Estimate(
            time, Status.START, T_odom_cam, reason, counts, clock.ms, None, covariance, step
        )

    def _lose(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Report a frame without a pose; when patience ends, the next view starts a new map."""
        s = self.settings
        self._lost_frames += 1
        self._T_before_now = np.eye(4)
        if self._lost_frames > s.patience:
            self._lost_map = self._lost_map or self._map
            self._map = empty_map(self._map.next_serial, self._map.next_id)
        reason = explain_failure(view, s) or (
            f"{counts['inliers']} inliers, need {s.motion.least_inliers}"
        )
        return Estimate(view.frame.timestamp_ns, Status.LOST, None, reason, counts, clock.ms)

    def _find_again(self, view: View) -> tuple[Array, Array] | None:
        """Pose and (6, 6) covariance of a view by the map of the segment that was lost."""
        if self._lost_map is None:
            return None
        found = find_again(self._lost_map, view, self.rig, self.settings, self._rng)
        if found is None:
            return None
        known = self._lost_map.keyframes[-1]
        T_cam_known = se3.inverse(found.T_world_cam) @ known.T_odom_cam
        carried = se3.carry_covariance(T_cam_known, known.covariance)
        return found.T_world_cam, carried + found.covariance

    def _stitch(self, view: View) -> None:
        """Move this segment to where its last keyframe sees the segment that was lost."""
        if found := self._find_again(view):
            T_odom_cam, covariance = found
            T_new_old = T_odom_cam @ se3.inverse(self._map.keyframes[-1].T_odom_cam)
            self._history.move(self._map.keyframes[0].serial, T_new_old)
            self._map, self._lost_map = self._map.moved(T_new_old, covariance), None
