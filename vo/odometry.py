"""The algorithm: stereo frames in, one pose and one status per frame out (thesis, algorithm 2)."""

import numpy as np

from vo.appearance import (
    explain_calibration,
    explain_failure,
    eyes_look_swapped,
    row_offset_px,
)
from vo.config import OdometrySettings
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, Hindsight, Observations, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.correspondence import Matches, find_matches, find_more
from vo.doubt import explain_doubt, is_unsettled
from vo.hooks import UNTOUCHED, Hooks
from vo.journey import Journey
from vo.local_bundle import refine_map
from vo.localisation import agreeing, orient, refine_pose
from vo.mapping import add_keyframe, is_new_view
from vo.noise import texture_to_noise, widened
from vo.recovery import ADRIFT
from vo.refine import Pose
from vo.replacement import replace_features, replace_inliers, replace_matches
from vo.smoothing import look_back
from vo.standing import Rest, stands
from vo.stereo import DenseStereo
from vo.triplets import Sighting, consistent
from vo.trust import believed, judge
from vo.view import View, look

ONE_EYED = 0.7
"""Share of inliers without disparity above which the right image shows something else."""


class StereoOdometry:
    """CenSurE, ZNCC marriage, P3P under RANSAC, and bundle adjustment over a window."""

    def __init__(
        self, rig: StereoRig, settings: OdometrySettings | None = None, hooks: Hooks = UNTOUCHED
    ) -> None:
        self.rig, self.hooks = rig, hooks
        self.settings = self._now = settings or OdometrySettings()  # as set, and for this image
        self._widened = widened(self.settings)
        self._dense_stereo = DenseStereo(self.settings.stereo)
        self._rng = np.random.default_rng(self.settings.seed)
        self._journey = Journey()
        self._smoothing_px = 0.0  # of noisy images

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        s, here, clock = self.settings, self._journey, Clock()
        if frame.timestamp_ns <= here.seen_ns:
            reason = f"not later than the frame before, at {here.seen_ns} ns"
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        here.seen_ns = frame.timestamp_ns
        view = self._look(frame, clock)  # CenSurE (3.2), dense stereo (3.1)
        counts = {"features": len(view.features), "matches": 0, "inliers": 0}
        if not here.map.keyframes:
            return self._start(view, counts, clock)

        for T_guess, reach_px in self._guesses(frame):
            located = self._locate(view, T_guess, reach_px, counts, clock)
            if located:
                break
        else:
            return self._lose(view, counts, clock)
        pose, matches, inliers = located
        if np.isnan(inliers.measured[:, 2]).mean() > ONE_EYED and eyes_look_swapped(view, s):
            return self._lose(view, counts, clock)

        with clock("structure refinement"):  # motion and structure, on long tracks (3.4, 4.4)
            here.map = here.map.seen(inliers.rows, inliers.features, view.vectors)
            here.before = Sighting(view.frame.left, inliers.ids, inliers.pixels)
            T_odom_cam, spread = self._settle(frame, view, pose, inliers, counts)
            if s.motion.prior:
                here.map, here.strikes = judge(here.map, here.strikes, matches.ids, inliers.ids)

        step = here.advance(view, T_odom_cam, spread)
        doubt = explain_doubt(len(inliers), counts["motion iterations"], s)
        status = Status.WEAK if doubt else Status.TRACKED
        reason = doubt or explain_calibration(here.row_offsets_px)
        seen = Observations(
            matches.ids, matches.pixels, matches.measured[:, 2], np.isin(matches.ids, inliers.ids)
        )
        covariance = here.covariance(T_odom_cam, spread)
        return Estimate(
            frame.timestamp_ns, status, T_odom_cam, reason, counts, clock.ms, seen, covariance, step
        )

    def reflect(self) -> Hindsight:
        """Return the map, and the trajectory as far as later frames corrected it."""
        return look_back(self._journey.history, self.rig, self.settings.refinement)

    def _look(self, frame: StereoFrame, clock: Clock) -> View:
        with clock("features"):
            faint = texture_to_noise(frame.left) < self.settings.faint.texture_to_noise
        self._now = self._widened if faint else self.settings
        view = look(frame, self._dense_stereo, self._now, clock, self._smoothing_px)
        return replace_features(self.hooks, view, self._now)

    def _guesses(self, frame: StereoFrame) -> tuple[tuple[Array, float], tuple[Array, float]]:
        """Predicted poses and how far to search about them: the expected motion, then any."""
        s, here = self._now.matching, self._journey
        steady = s.predict == "steady" and not self._wheels_rest(frame)
        expected = here.T_odom_cam @ (here.T_before_now if steady else np.eye(4))
        expected = self.hooks.predicted(frame, here.last_ns, here.T_odom_cam, expected)
        return (expected, s.search_px), (here.T_odom_cam, s.widest_search_px)

    def _locate(
        self, view: View, T_guess: Array, reach_px: float, counts: dict[str, int], clock: Clock
    ) -> tuple[Pose, Matches, Matches] | None:
        """Match about a guess and estimate the pose: with it all matches, and the inliers."""
        s, rig, hooks, local_map = self._now, self.rig, self.hooks, self._journey.map
        with clock("matching"):  # marriage by ZNCC, sub-pixel alignment (3.2)
            matches = find_matches(local_map, view, T_guess, reach_px, rig, s)
            matches = replace_matches(hooks, self._confirmed(matches, view), local_map, view, s)
            counts["matches"] = len(matches)
        with clock("motion"):  # orientation under RANSAC (3.3)
            weights = believed(matches, local_map, self._journey.strikes, T_guess, rig, s)
            consensus = orient(matches, T_guess, weights, rig, s, self._rng)
            if consensus is None:
                return None
            agreed = replace_inliers(hooks, view, matches, matches.select(consensus.inliers))
            counts["consensus"] = len(agreed)
            if len(agreed) < s.motion.least_inliers:
                return None
        with clock("motion refinement"):  # at every frame (3.4)
            pose = refine_pose(consensus.T, agreed, rig, s)
            counts["motion iterations"] = pose.iterations
        if s.matching.guided:
            with clock("guided matching"):  # the other landmarks, where the pose puts them (F5)
                matches = find_more(local_map, view, pose.T_world_cam, matches, rig, s)
                matches = replace_matches(hooks, self._confirmed(matches, view), local_map, view, s)
                agreed = agreeing(pose.T_world_cam, matches, rig, s.motion)
                agreed = replace_inliers(hooks, view, matches, agreed)
                pose = refine_pose(pose.T_world_cam, agreed, rig, s)
                counts["motion iterations"] += pose.iterations
        inliers = agreeing(pose.T_world_cam, matches, rig, s.motion)
        inliers = replace_inliers(hooks, view, matches, inliers)
        counts["found"], counts["inliers"] = len(matches), len(inliers)
        return (pose, matches, inliers) if len(inliers) >= s.motion.least_inliers else None

    def _confirmed(self, matches: Matches, view: View) -> Matches:
        """Matches that the frame before confirms, if it is asked (F4)."""
        s, here = self._now.matching, self._journey
        if not s.triplets or here.before is None:
            return matches
        landmarks, left = here.map.landmarks, view.frame.left
        return matches.select(consistent(matches, landmarks, here.before, left, s.align_px))

    def _wheels_rest(self, frame: StereoFrame) -> bool:
        """Whether encoders say that no wheel has turned since the camera last moved."""
        rest, ticks = self._journey.rest, frame.wheel_ticks
        return (
            self._now.standing == "encoders"
            and rest is not None
            and (ticks is not None and ticks == rest.wheel_ticks)
        )

    def _settle(
        self, frame: StereoFrame, view: View, pose: Pose, inliers: Matches, counts: dict[str, int]
    ) -> tuple[Array, Array]:
        """The pose held if the camera stands (5.1.3, E11), or else after the map has grown.

        Returns:
            (4, 4) T_odom_cam, and its (6, 6) covariance given the map.
        """
        rest, standing = self._journey.rest, self._now.standing
        ticks = frame.wheel_ticks if standing == "encoders" else None
        if rest and standing != "none" and stands(rest, inliers, ticks, self.rig):
            return rest.T_odom_cam, rest.spread
        T_odom_cam = self._refine(view, pose, inliers, counts)
        self._journey.rest = Rest(
            T_odom_cam, pose.covariance, inliers.ids, inliers.pixels, frame.wheel_ticks
        )
        return T_odom_cam, pose.covariance

    def _refine(self, view: View, pose: Pose, inliers: Matches, counts: dict[str, int]) -> Array:
        """Let a new view grow and refine the map; the pose (4, 4) afterwards."""
        s, rig, here, T_odom_cam = self._now, self.rig, self._journey, pose.T_world_cam
        unsettled = is_unsettled(counts["motion iterations"], s)  # (5.3)
        last, few = here.map.keyframes[-1], s.motion.weak_inliers
        if unsettled or not is_new_view(last, inliers, s.refinement, few):
            return T_odom_cam
        spread = here.covariance(T_odom_cam, pose.covariance)
        here.map = add_keyframe(here.map, view, T_odom_cam, spread, inliers, rig, s, self.hooks)
        here.map, counts["structure iterations"] = refine_map(here.map, rig, s)
        here.stitch(view, rig, s, self._rng)  # to a segment that was lost (6)
        here.history.remember(here.map, s.refinement)
        if not np.isnan(lower_px := row_offset_px(view, inliers.measured, s)):
            here.row_offsets_px.append(lower_px)
        if here.map.depth_share < s.features.clear_share:
            self._smoothing_px = s.features.smoothing_px
        return here.map.keyframes[-1].T_odom_cam

    def _start(self, view: View, counts: dict[str, int], clock: Clock) -> Estimate:
        """Begin a map where the old one knows the view, or else at the last pose."""
        time, s, here = view.frame.timestamp_ns, self._now, self._journey
        lost = here.lost_frames
        known = here.find_again(view, self.rig, s, self._rng)
        elsewhere = ADRIFT * np.eye(6) if lost else np.zeros((6, 6))
        T_odom_cam, covariance = known or (here.T_odom_cam, elsewhere)
        fresh = add_keyframe(here.map, view, T_odom_cam, covariance, None, self.rig, s, self.hooks)
        noisy = fresh.depth_share < s.features.clear_share
        if noisy and self._smoothing_px < s.features.smoothing_px:
            self._smoothing_px = s.features.smoothing_px
            return self._start(self._look(view.frame, clock), counts, clock)
        counts["fresh"] = len(fresh.landmarks)
        if len(fresh.landmarks) < s.motion.least_inliers:
            few = f"{len(fresh.landmarks)} features with depth, need {s.motion.least_inliers}"
            return self._lose(view, counts, clock, few)
        here.map, here.lost_map = fresh, None if known else here.lost_map
        here.history.remember(fresh, s.refinement)
        step = here.advance(view, T_odom_cam, np.zeros((6, 6))) + covariance
        reason = f"new segment after {lost} lost frames" if lost else ""
        return Estimate(
            time, Status.START, T_odom_cam, reason, counts, clock.ms, None, covariance, step
        )

    def _lose(
        self, view: View, counts: dict[str, int], clock: Clock, few: str | None = None
    ) -> Estimate:
        """Report a frame without a pose, and what is wrong with it."""
        self._journey.lose(self.settings.patience)
        few = few or f"{counts['inliers']} inliers, need {self.settings.motion.least_inliers}"
        reason = explain_failure(view, self._now) or few
        return Estimate(view.frame.timestamp_ns, Status.LOST, None, reason, counts, clock.ms)
