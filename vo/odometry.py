"""The algorithm: stereo frames in, one pose and one status per frame out (thesis, algorithm 2)."""

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, Observations, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.correspondence import find_matches
from vo.mapping import add_keyframe, is_new_view, refine_map
from vo.motion import acceptance, find_motion, reprojection_errors
from vo.refine import refine_motion
from vo.stereo import DenseStereo
from vo.tracks import empty_map
from vo.view import View, look


class StereoOdometry:
    """CenSurE, ZNCC marriage, P3P under RANSAC, and bundle adjustment over a window."""

    def __init__(self, rig: StereoRig, settings: OdometrySettings | None = None) -> None:
        self.rig = rig
        self.settings = settings or OdometrySettings()
        self._dense_stereo = DenseStereo(self.settings.stereo)
        self._rng = np.random.default_rng(self.settings.seed)
        self._map = empty_map()
        self._T_odom_cam = np.eye(4)  # of the last frame that had a pose
        self._T_before_now = np.eye(4)  # its motion, which predicts the next
        self._lost_frames = 0

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        s, rig, clock = self.settings, self.rig, Clock()
        view = look(frame, self._dense_stereo, s, clock)
        counts = {"features": len(view.features), "matches": 0, "inliers": 0}
        if not self._map.keyframes:
            return self._start(view, counts, clock)

        for T_guess, reach_px in self._guesses():
            with clock("matching"):  # marriage by ZNCC, sub-pixel alignment (3.2)
                matches = find_matches(self._map, view, T_guess, reach_px, rig, s)
                counts["matches"] = len(matches)
            with clock("motion"):  # orientation under RANSAC (3.3)
                rays = rig.normalized(matches.pixels)
                points_cam = rig.triangulate(matches.pixels, matches.disparity_px)
                consensus = find_motion(
                    matches.points_odom, rays, points_cam, s.motion, self._rng, rig.f_px
                )
                if consensus is None or consensus.inliers.sum() < s.motion.least_inliers:
                    continue
            with clock("motion refinement"):  # at every frame (3.4)
                T_odom_cam, counts["motion iterations"] = refine_motion(
                    consensus.T, *matches.select(consensus.inliers).measured, rig, s.refinement
                )
                errors = reprojection_errors(T_odom_cam, matches.points_odom, rays)
                inliers = matches.select(errors < acceptance(s.motion, rig.f_px))
                counts["inliers"] = len(inliers)
            if len(inliers) >= s.motion.least_inliers:
                break
        else:
            return self._lose(view, counts, clock)

        with clock("structure refinement"):  # motion and structure, on long tracks (3.4, 4.4)
            self._map = self._map.seen(inliers.rows, view.vectors[inliers.features])
            if is_new_view(self._map.keyframes[-1], inliers, s.refinement):
                self._map = add_keyframe(self._map, view, T_odom_cam, inliers, rig, s)
                self._map, counts["structure iterations"] = refine_map(self._map, rig, s)
                T_odom_cam = self._map.keyframes[-1].T_odom_cam

        self._T_before_now = se3.inverse(self._T_odom_cam) @ T_odom_cam
        self._T_odom_cam, self._lost_frames = T_odom_cam, 0
        weak = len(inliers) < s.motion.weak_inliers
        status = Status.WEAK if weak else Status.TRACKED
        reason = f"{len(inliers)} inliers, fewer than {s.motion.weak_inliers}" if weak else ""
        seen = Observations(
            matches.ids, matches.pixels, matches.disparity_px, np.isin(matches.ids, inliers.ids)
        )
        return Estimate(frame.timestamp_ns, status, T_odom_cam, reason, counts, clock.ms, seen)

    def _guesses(self) -> tuple[tuple[Array, float], tuple[Array, float]]:
        """Predicted poses and how far to search about them: steady motion, then any motion."""
        s = self.settings.matching
        return (
            (self._T_odom_cam @ self._T_before_now, s.search_px),
            (self._T_odom_cam, s.widest_search_px),
        )

    def _start(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Begin a map at the last known pose, if the view shows enough points with depth."""
        time, s = view.frame.timestamp_ns, self.settings
        fresh = add_keyframe(self._map, view, self._T_odom_cam, None, self.rig, s)
        counts["fresh"] = len(fresh.landmarks)
        if len(fresh.landmarks) < s.motion.least_inliers:
            self._lost_frames += 1
            reason = f"{len(fresh.landmarks)} features with depth, need {s.motion.least_inliers}"
            return Estimate(time, Status.LOST, None, reason, counts, clock.ms)
        reason = f"resumed after {self._lost_frames} lost frames" if self._lost_frames else ""
        self._map, self._T_before_now, self._lost_frames = fresh, np.eye(4), 0
        return Estimate(time, Status.START, self._T_odom_cam, reason, counts, clock.ms)

    def _lose(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Report a frame without a pose; when patience ends, the next view starts a new map."""
        s = self.settings
        self._lost_frames += 1
        self._T_before_now = np.eye(4)
        if self._lost_frames > s.patience:
            self._map = empty_map(self._map.next_serial, self._map.next_id)
        reason = f"{counts['inliers']} inliers, need {s.motion.least_inliers}"
        return Estimate(view.frame.timestamp_ns, Status.LOST, None, reason, counts, clock.ms)
