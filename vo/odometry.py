"""Stereo visual odometry: stereo frames in, one pose and one status a frame out.

Numbers in parentheses are sections of the thesis; "decision" is a note in docs/decisions.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, FinalResult, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import View, newest_matches
from vo.map.local_map import TrackedFrame, pose_covariance, transform_map
from vo.map.run_history import RunHistory
from vo.map.state import Halt, TrackerState
from vo.mapping import relocalization
from vo.mapping.batch_smoothing import smooth
from vo.mapping.keyframes import add_keyframe, needs_keyframe
from vo.mapping.relocalization import mark_lost, relocalize
from vo.mapping.window_adjustment import adjuster
from vo.tracking import diagnostics
from vo.tracking.association import add_observations
from vo.tracking.frontend import Frontend
from vo.tracking.landmark_prior import cull_landmarks
from vo.tracking.stationary import detect_stationary, start_halt
from vo.tracking.track_local_map import (
    Context,
    NotTracked,
    Tracked,
    is_reliable,
    predict_pose,
    retry_tracking,
    shows_swapped_images,
    track_local_map,
)


class StereoOdometry:
    """CenSurE, ZNCC, P3P under RANSAC, and bundle adjustment of a window of keyframes.

    Frames are passed to `track` one by one, in order of time, live or from a recording. Hooks may
    replace the output of a stage; the state is what one frame hands to the next.

    Args:
        rig: Calibration of the rectified pair.
        settings: Settings of all stages; `driftyard settings estimator` lists them with units.
        hooks: Functions that replace the output of a stage.

    Example:
        >>> odometry = dy.StereoOdometry(ds.rig)
        >>> [odometry.track(frame).status.value for frame in (ds[0], ds[1])]
        ['start', 'tracked']
    """

    def __init__(
        self, rig: StereoRig, settings: OdometrySettings | None = None, hooks: Hooks = NO_HOOKS
    ) -> None:
        self.rig, self.settings, self.hooks = rig, settings or OdometrySettings(), hooks
        self.state = TrackerState()
        self._history = RunHistory()
        self._frontend = Frontend(rig, self.settings)
        self._adjust = adjuster(rig, self.settings.refinement)
        self._rng = np.random.default_rng(self.settings.seed)

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        state, clock = self.state, Clock()
        if frame.timestamp_ns <= state.frame_ns:
            reason = f"not later than the frame before, at {state.frame_ns} ns"
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        view = self._frontend.process(frame, state.smoothing_px, self.hooks, clock)  # (3.1, 3.2)
        state.frame_ns, state.smoothing_px = frame.timestamp_ns, view.smoothing_px
        if not state.map.keyframes:
            return self._initialize(view, clock)

        context = Context(self.hooks, self._rng, clock)
        T_guess = predict_pose(state, view, self.hooks)  # constant velocity, or at rest
        tracked = track_local_map(state, view, T_guess, context)  # match, P3P, refine (3.2-3.4)
        if not is_reliable(tracked, state.map):  # a low ratio of inliers, or no pose
            # By a rotation prior, by KLT and in a wide search (decision 22).
            tracked = retry_tracking(state, view, T_guess, first=tracked, context=context)
        if isinstance(tracked, NotTracked) or shows_swapped_images(tracked, view):
            return self._lose(view, tracked.counts, clock)

        with clock("structure refinement"):
            state.map = add_observations(state.map, tracked.view, tracked.inliers)
            state.previous = TrackedFrame(tracked.view.frame.left, tracked.inliers)
            halt = detect_stationary(state.halt, tracked.view, tracked.inliers)
            if halt:  # zero-velocity update (5.1.3)
                tracked = replace(tracked, T_odom_cam=halt.T_odom_cam, covariance=halt.covariance)
            elif needs_keyframe(state.map, tracked):
                tracked = self._add_keyframe(tracked)  # bundle adjustment (3.4, 4.4)
            step_covariance = self._advance(tracked, halt)
        return self._estimate(tracked, step_covariance, clock)

    def finalize(self) -> FinalResult:
        """Return the map and, unless `refinement.smooth` is none, the smoothed trajectory (4.2)."""
        history, refinement = self._history, self.settings.refinement
        if refinement.smooth == "global":
            history = smooth(history, self.rig, refinement)
        trajectory = None if refinement.smooth == "none" else history.trajectory
        return FinalResult(trajectory, history.point_map)

    def _initialize(self, view: View, clock: Clock) -> Estimate:
        """Start a map at the pose that the lost map gives, or else at the last pose."""
        state, lost_frames, none = self.state, self.state.lost_frames, np.zeros((6, 6))
        found = relocalize(state.lost_map, view, self._rng)  # (6)
        unknown = relocalization.LIMITS.unknown_variance * np.eye(6) if lost_frames else none
        T_odom_cam, covariance = found or (state.T_odom_cam, unknown)
        new = add_keyframe(state.map, view, T_odom_cam, covariance, hooks=self.hooks)
        n, min_inliers = len(new.landmarks), view.settings.motion.min_inliers
        counts = {"matches": 0, "inliers": 0, "fresh": n}
        if n < min_inliers:
            return self._lose(view, counts, clock, f"{n} features with depth, need {min_inliers}")
        state.map, state.lost_map = new, None if found else state.lost_map
        self._history.record_map(new, view.settings.refinement)
        state.previous = new.keyframes[-1]
        state.halt = start_halt(state.T_odom_cam, T_odom_cam, none, view, newest_matches(new))
        return Estimate(
            view.frame.timestamp_ns,
            Status.START,
            T_odom_cam,
            reason=f"new segment after {lost_frames} lost frames" if lost_frames else "",
            counts={"features": len(view.features), **counts},
            timings_ms=clock.ms,
            covariance=covariance,
            step_covariance=self._set_pose(view, T_odom_cam, none) + covariance,
        )

    def _lose(
        self, view: View, counts: Mapping[str, int], clock: Clock, few: str | None = None
    ) -> Estimate:
        """Report a frame without a pose; after some, the next one starts a new map."""
        state, settings = self.state, self.settings
        state.lost_frames += 1
        state.T_last_cam = np.eye(4)
        state.map, state.lost_map = mark_lost(
            state.map, state.lost_map, state.lost_frames, settings.patience_frames
        )
        few = few or f"{counts['inliers']} inliers, need {settings.motion.min_inliers}"
        return Estimate(
            view.frame.timestamp_ns,
            Status.LOST,
            None,
            reason=diagnostics.explain_failure(view) or few,
            counts={"features": len(view.features), **counts},
            timings_ms=clock.ms,
        )

    def _add_keyframe(self, tracked: Tracked) -> Tracked:
        """Add a keyframe, adjust the map, and merge it with a lost one that the keyframe sees."""
        state, view, inliers = self.state, tracked.view, tracked.inliers
        T_odom_cam = tracked.T_odom_cam
        covariance = pose_covariance(state.map.keyframes[-1], T_odom_cam, tracked.covariance)
        new = add_keyframe(state.map, view, T_odom_cam, covariance, inliers, self.hooks)
        state.map, iterations = self._adjust(new)
        state.previous = keyframe = state.map.keyframes[-1]
        if found := relocalize(state.lost_map, view, self._rng):  # (6)
            T_odom_cam, covariance = found
            T_new_old = T_odom_cam @ se3.inverse(keyframe.T_odom_cam)
            self._history.transform(state.map.keyframes[0].serial, T_new_old)
            state.map, state.lost_map = transform_map(state.map, T_new_old, covariance), None
        self._history.record_map(state.map, view.settings.refinement)
        state.row_offsets_px = diagnostics.add_row_offset(state.row_offsets_px, view, inliers)
        counts = {**tracked.counts, "structure iterations": iterations}
        return replace(tracked, T_odom_cam=state.map.keyframes[-1].T_odom_cam, counts=counts)

    def _advance(self, tracked: Tracked, halt: Halt | None) -> Array:
        """Remember the pose of a tracked frame; return the covariance of the step to it."""
        state, view, inliers = self.state, tracked.view, tracked.inliers
        pose = tracked.T_odom_cam, tracked.covariance
        state.halt = halt or start_halt(state.T_odom_cam, *pose, view, inliers)
        cull_landmarks(state, view, tracked.matches, inliers)
        return self._set_pose(view, *pose)

    def _estimate(self, tracked: Tracked, step_covariance: Array, clock: Clock) -> Estimate:
        """Report the pose of a tracked frame."""
        view, counts, T_odom_cam = tracked.view, tracked.counts, tracked.T_odom_cam
        inliers, iterations = len(tracked.inliers), counts["motion iterations"]
        weakness = diagnostics.explain_weakness(inliers, iterations, view.settings)
        keyframe = self.state.map.keyframes[-1]
        return Estimate(
            view.frame.timestamp_ns,
            Status.WEAK if weakness else Status.TRACKED,
            T_odom_cam,
            reason=weakness or diagnostics.explain_calibration(self.state.row_offsets_px),
            counts={"features": len(view.features), **counts},
            timings_ms=clock.ms,
            observations=tracked.observations(),
            covariance=pose_covariance(keyframe, T_odom_cam, tracked.covariance),
            step_covariance=step_covariance,
        )

    def _set_pose(self, view: View, T_odom_cam: Array, covariance: Array) -> Array:
        """Set the pose and its covariance given the map; return the covariance of the step."""
        state, keyframe = self.state, self.state.map.keyframes[-1]
        T_cam_last = se3.inverse(T_odom_cam) @ state.T_odom_cam
        step_covariance = se3.transform_covariance(T_cam_last, state.covariance) + covariance
        state.T_last_cam, state.T_odom_cam = se3.inverse(T_cam_last), T_odom_cam
        state.covariance, state.lost_frames = covariance, 0
        state.pose_ns = view.frame.timestamp_ns
        T_keyframe_cam = se3.inverse(keyframe.T_odom_cam) @ T_odom_cam
        self._history.frames.append((state.pose_ns, keyframe.serial, T_keyframe_cam))
        return step_covariance
