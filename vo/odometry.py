"""The algorithm: stereo frames in, one pose and one status per frame out (thesis, algorithm 2)."""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, FinalResult, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import UNTOUCHED, Hooks
from vo.map.frame import View
from vo.map.state import Journey
from vo.mapping.batch_smoothing import look_back
from vo.mapping.keyframes import add_keyframe
from vo.mapping.map_update import grow
from vo.mapping.relocalization import ADRIFT
from vo.tracking.appearance import explain_calibration, explain_failure
from vo.tracking.context import Gear
from vo.tracking.doubt import explain_doubt
from vo.tracking.frontend import Eyes
from vo.tracking.landmark_prior import judge
from vo.tracking.stationary import Glimpse, glimpse
from vo.tracking.track_local_map import locate


class StereoOdometry:
    """CenSurE, ZNCC marriage, P3P under RANSAC, and bundle adjustment over a window."""

    def __init__(
        self, rig: StereoRig, settings: OdometrySettings | None = None, hooks: Hooks = UNTOUCHED
    ) -> None:
        self.rig, self.settings = rig, settings or OdometrySettings()
        self._gear = Gear(rig, hooks, np.random.default_rng(self.settings.seed))
        self._eyes = Eyes(self.settings, hooks)
        self._journey = Journey()

    @property
    def hooks(self) -> Hooks:
        """What may replace a stage's output; may be set until the first frame."""
        return self._gear.hooks

    @hooks.setter
    def hooks(self, hooks: Hooks) -> None:
        self._gear = replace(self._gear, hooks=hooks)
        self._eyes = Eyes(self.settings, hooks)

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        here, gear, clock = self._journey, self._gear, Clock()
        if frame.timestamp_ns <= here.seen_ns:
            reason = f"not later than the frame before, at {here.seen_ns} ns"
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        here.seen_ns = frame.timestamp_ns
        view = self._eyes.look(frame, clock)  # CenSurE (3.2), dense stereo (3.1)
        counts = {"features": len(view.features), "matches": 0, "inliers": 0}
        if not here.map.keyframes:
            return self._start(view, counts, clock)

        found = locate(here, view, gear, counts, clock)  # matching, RANSAC, refinement (3.2-3.4)
        if found is None:
            return self._lose(view, counts, clock)
        view = found.view

        with clock("structure refinement"):  # motion and structure, on long tracks (3.4, 4.4)
            here.note(view, found.inliers)
            rest = here.halt(view, found.inliers, gear.rig)  # (5.1.3, E11)
            if rest is None:
                T_odom_cam = grow(here, view, found, gear, counts)
                spread, seen = found.pose.covariance, glimpse(found.inliers)
                rest = here.leave(T_odom_cam, spread, view, seen)
            if view.settings.motion.landmark_prior:
                agreed = found.inliers.ids
                here.map, here.strikes = judge(here.map, here.strikes, found.matches.ids, agreed)

        step = here.advance(view, rest.T_odom_cam, rest.spread)
        doubt = explain_doubt(len(found.inliers), counts["motion iterations"], view.settings)
        return Estimate(
            frame.timestamp_ns,
            Status.WEAK if doubt else Status.TRACKED,
            rest.T_odom_cam,
            doubt or explain_calibration(here.row_offsets_px),
            counts,
            clock.ms,
            found.observations(),
            here.covariance(rest.T_odom_cam, rest.spread),
            step,
        )

    def finalize(self) -> FinalResult:
        """Return the map, and the trajectory as far as later frames corrected it."""
        return look_back(self._journey.history, self.rig, self.settings.refinement)

    def _start(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Begin a map where the old one knows the view, or else at the last pose."""
        s, here, gear = view.settings, self._journey, self._gear
        lost = here.lost_frames
        known = here.find_again(view, gear.rig, s, gear.rng)
        elsewhere = ADRIFT * np.eye(6) if lost else np.zeros((6, 6))
        T_odom_cam, covariance = known or (here.T_odom_cam, elsewhere)
        fresh = add_keyframe(here.map, view, T_odom_cam, covariance, None, gear.rig, s, gear.hooks)
        counts["fresh"] = len(fresh.landmarks)
        if len(fresh.landmarks) < s.motion.min_inliers:
            few = f"{len(fresh.landmarks)} features with depth, need {s.motion.min_inliers}"
            return self._lose(view, counts, clock, few)
        here.map, here.lost_map = fresh, None if known else here.lost_map
        here.history.remember(fresh, s.refinement)
        first = Glimpse(
            fresh.landmarks.ids, fresh.keyframes[-1].measured[:, :2], fresh.landmarks.points_odom
        )
        here.before = fresh.keyframes[-1].sighting
        here.leave(T_odom_cam, np.zeros((6, 6)), view, first)
        step = here.advance(view, T_odom_cam, np.zeros((6, 6))) + covariance
        reason = f"new segment after {lost} lost frames" if lost else ""
        time_ns = view.frame.timestamp_ns
        return Estimate(
            time_ns, Status.START, T_odom_cam, reason, counts, clock.ms, None, covariance, step
        )

    def _lose(
        self, view: View, counts: dict[str, int], clock: Clock, few: str | None = None
    ) -> Estimate:
        """Report a frame without a pose, and what is wrong with it."""
        self._journey.lose(self.settings.patience_frames)
        few = few or f"{counts['inliers']} inliers, need {self.settings.motion.min_inliers}"
        reason = explain_failure(view, view.settings) or few
        return Estimate(view.frame.timestamp_ns, Status.LOST, None, reason, counts, clock.ms)
