"""Stereo visual odometry: stereo frames in, one pose and one status a frame out.

Numbers in parentheses are sections of the thesis; "decision" is a note in docs/decisions.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vo.calibration.self_calibration import NO_SAMPLES
from vo.calibration.stereo_errors import StereoSamples
from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, FinalResult, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import View, newest_matches
from vo.map.local_map import TrackedFrame, pose_covariance
from vo.map.run_history import RunHistory
from vo.map.state import Halt, TrackerState
from vo.mapping.batch_smoothing import smooth
from vo.mapping.keyframes import add_keyframe, needs_keyframe
from vo.mapping.mapper import Mapper
from vo.mapping.relocalization import mark_lost, relocalize
from vo.tracking import diagnostics
from vo.tracking.association import add_observations
from vo.tracking.budget import Budget
from vo.tracking.evidence import disagreement, explain_weak_step, start_covariance
from vo.tracking.frontend import Frontend
from vo.tracking.gyro_motion import explain_gyro, learn_gyro
from vo.tracking.landmark_prior import cull_landmarks
from vo.tracking.motion_model import gap_covariance
from vo.tracking.right_view import add_step, correct_cameras
from vo.tracking.stationary import detect_stationary, start_halt
from vo.tracking.track_displaced import track_displaced
from vo.tracking.track_local_map import (
    predict_pose,
    search_pose,
    shows_swapped_images,
)
from vo.tracking.tracked import Context, NotTracked, Tracked
from vo.tracking.wheel_motion import explain_wheels, learn_wheels, read_wheels


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
        self._rng = np.random.default_rng(self.settings.seed)
        self._budget = Budget(self.settings.budget_ms)
        self._mapper = Mapper(rig, self.settings, self._history, self._rng)

    def track(self, frame: StereoFrame) -> Estimate:
        """Estimate the pose of the next frame; never raises on image content."""
        state, mapper, clock = self.state, self._mapper, Clock()
        if frame.timestamp_ns <= state.frame_ns:
            reason = f"not later than the frame before, at {state.frame_ns} ns"
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        frame = read_wheels(state, frame, self.settings)
        state.angles_rad = frame.gyro_rad
        self._budget.begin()
        waits = state.has_work and self._budget.lets_keyframe_wait()
        counts: dict[str, int] = {}
        if not waits:
            with clock("structure refinement"):
                mapper.step(state, self.hooks, counts)
        before = state.smoothing_px, state.is_band_passed
        view = self._frontend.process(frame, *before, self.hooks, clock)  # (3.1, 3.2)
        state.smoothing_px, state.is_band_passed = view.smoothing_px, view.is_band_passed
        state.frame_ns = frame.timestamp_ns
        if not state.map.keyframes:
            return self._initialize(view, frame, clock)

        context = Context(self.hooks, self._rng, clock, self._budget)
        T_guess = predict_pose(state, view, self.hooks)  # constant velocity, or at rest
        view = correct_cameras(state, view, T_guess)
        tracked: Tracked | NotTracked = NotTracked({"matches": 0, "inliers": 0})
        if self.settings.matching.search == "displacement" and state.previous:
            tracked = track_displaced(state, state.previous, view, T_guess, context)
        tracked = search_pose(state, view, T_guess, first=tracked, context=context)  # (3.2-3.4)
        if isinstance(tracked, NotTracked) or shows_swapped_images(tracked, view):
            return self._lose(view, frame, tracked.counts, clock)

        with clock("structure refinement"):
            state.map = add_observations(state.map, tracked.view, tracked.inliers)
            state.previous = TrackedFrame(tracked.view.frame.left, tracked.inliers)
            halt = detect_stationary(state.halt, tracked.view, tracked.inliers)
            if halt:  # zero-velocity update (5.1.3)
                held = halt.covariance + disagreement(halt.T_odom_cam, tracked.T_odom_cam)
                tracked = replace(tracked, T_odom_cam=halt.T_odom_cam, covariance=held)
            # The exposure has found its level: what was seen before is mostly rounding.
            is_clearer = state.is_faint and not view.is_faint
            is_urgent = state.has_work
            if is_keyframe := is_clearer or (not halt and needs_keyframe(tracked)):
                state.is_faint = False
                moved = mapper.finish(state, self.hooks, counts)  # left to do by the one before
                tracked = tracked.moved(moved, state.map.landmarks)
            step_covariance = self._advance(tracked, halt)
            if is_keyframe:
                mapper.begin(state, tracked)  # bundle adjustment (3.4, 4.4)
                if is_urgent or not self.settings.refinement.deferred:
                    moved = mapper.finish(state, self.hooks, counts)
                    tracked = tracked.moved(moved, state.map.landmarks)
        tracked = replace(tracked, counts={**tracked.counts, **counts})
        return self._estimate(tracked, step_covariance, clock)

    @property
    def calibration_samples(self) -> StereoSamples:
        """Points that both cameras saw; none unless `self_calibration` is auto."""
        return self._mapper.calibration.samples if self._mapper.calibration else NO_SAMPLES

    def finalize(self) -> FinalResult:
        """Return the map and, unless `refinement.smooth` is none, the smoothed trajectory (4.2)."""
        self._mapper.finish(self.state, self.hooks, {})
        history, refinement = self._history, self.settings.refinement
        if refinement.smooth == "global":
            history = smooth(history, self.rig, refinement)
        trajectory = None if refinement.smooth == "none" else history.trajectory
        return FinalResult(trajectory, history.point_map)

    def _initialize(self, view: View, frame: StereoFrame, clock: Clock) -> Estimate:
        """Start a map at the pose that the lost map gives, or else at the last pose."""
        state, lost_frames, none = self.state, self.state.lost_frames, np.zeros((6, 6))
        found = relocalize(state.lost_map, view, self._rng)  # (6)
        T_odom_cam, covariance = found or (state.T_odom_cam, none)
        if lost_frames and not found:  # as if the last motion had gone on
            T_odom_cam = predict_pose(state, view, self.hooks)
            covariance = gap_covariance(state, view.frame)
        view = correct_cameras(state, view, T_odom_cam)
        new = add_keyframe(state.map, view, T_odom_cam, covariance, hooks=self.hooks)
        n, min_inliers = len(new.landmarks), view.settings.motion.min_inliers
        counts = {"matches": 0, "inliers": 0, "fresh": n}
        if n < min_inliers:
            few = f"{n} features with depth, need {min_inliers}"
            return self._lose(view, frame, counts, clock, few)
        state.map, state.lost_map = new, None if found else state.lost_map
        self._history.record_map(new, view.settings.refinement)
        state.previous, state.is_faint = new.keyframes[-1], view.is_faint
        state.halt = start_halt(state.T_odom_cam, T_odom_cam, none, view, newest_matches(new))
        state.wheels = replace(state.wheels, readings=state.ticks)
        state.gyro = replace(state.gyro, readings=state.angles_rad)
        step_covariance, _ = self._report(T_odom_cam, self._set_pose(view, T_odom_cam, none))
        step_covariance, state.drift = step_covariance + covariance, none
        return Estimate(
            view.frame.timestamp_ns,
            Status.START,
            T_odom_cam,
            reason=f"new segment after {lost_frames} lost frames" if lost_frames else "",
            counts={**view.detection.counts, **counts},
            timings_ms=clock.ms,
            covariance=covariance,
            step_covariance=step_covariance,
            drift_covariance=step_covariance,
        )

    def _lose(
        self, view: View, frame: StereoFrame, counts: Mapping[str, int], clock: Clock,
        few: str | None = None,
    ) -> Estimate:  # fmt: skip
        """Report a frame without a pose; after some, the next one starts a new map."""
        self._mapper.finish(self.state, self.hooks, {})
        state, settings = self.state, self.settings
        state.lost_frames += 1
        state.map, state.lost_map = mark_lost(
            state.map, state.lost_map, state.lost_frames, settings.patience_frames
        )
        few = few or f"{counts['inliers']} inliers, need {settings.motion.min_inliers}"
        return Estimate(
            view.frame.timestamp_ns,
            Status.LOST,
            None,
            reason=diagnostics.explain_failure(view, frame) or few,
            counts={**view.detection.counts, **counts},
            timings_ms=clock.ms,
        )

    def _advance(self, tracked: Tracked, halt: Halt | None) -> Array:
        """Remember the pose of a tracked frame; return the covariance of the step to it."""
        state, view, inliers = self.state, tracked.view, tracked.inliers
        pose = tracked.T_odom_cam, tracked.covariance
        state.halt = halt or start_halt(state.T_odom_cam, *pose, view, inliers)
        cull_landmarks(state, view, tracked.matches, inliers)
        was_lost, step_covariance = state.lost_frames > 0, self._set_pose(view, *pose)
        step = None if was_lost else state.T_last_cam
        state.wheels = learn_wheels(state.wheels, state.ticks, step, step_covariance)
        state.gyro = learn_gyro(state.gyro, state.angles_rad, step, step_covariance)
        return step_covariance

    def _estimate(self, tracked: Tracked, step_covariance: Array, clock: Clock) -> Estimate:
        """Report the pose of a tracked frame."""
        view, counts, T_odom_cam = tracked.view, tracked.counts, tracked.T_odom_cam
        step_covariance, moved = self._report(T_odom_cam, step_covariance)
        is_start = len(self.state.map.keyframes) == 1
        drift, self.state.drift = self.state.drift, np.zeros((6, 6))
        inliers, iterations = len(tracked.inliers), counts["motion iterations"]
        weakness = diagnostics.explain_weakness(inliers, iterations, view.settings)
        weakness = weakness or explain_weak_step(
            self.state.T_last_cam, step_covariance, moved, tracked, is_start, view.settings,
        )  # fmt: skip
        if is_start:
            step_covariance = step_covariance + start_covariance(tracked.inliers, self.rig)
        misaligned = diagnostics.explain_calibration(self.state.row_offsets_px)
        if self.settings.self_calibration == "auto":  # more than it could correct
            weakness = weakness or misaligned
        said = "; ".join(x for x in (weakness, self._budget.end()) if x)
        unused = explain_wheels(self.state.wheels) or explain_gyro(self.state.gyro)
        return Estimate(
            view.frame.timestamp_ns,
            Status.WEAK if weakness else Status.TRACKED,
            T_odom_cam,
            reason=said or misaligned or unused,
            counts={**view.detection.counts, **counts},
            timings_ms=clock.ms,
            observations=tracked.observations(),
            covariance=self.state.odom_covariance,
            step_covariance=step_covariance,
            drift_covariance=drift,
        )

    def _report(self, T_odom_cam: Array, step_covariance: Array) -> tuple[Array, Array]:
        """Report a pose; return the covariance of the step from the last one reported.

        What the map moved meanwhile, which is also returned as a covariance, is an error of the
        steps before; this one makes it good.
        """
        state = self.state
        T_last_cam = se3.inverse(state.T_reported) @ T_odom_cam
        state.T_reported = T_odom_cam
        moved = disagreement(T_last_cam, state.T_last_cam)
        return step_covariance + moved, moved

    def _set_pose(self, view: View, T_odom_cam: Array, covariance: Array) -> Array:
        """Set the pose and its covariance given the map; return the covariance of the step."""
        state, keyframe = self.state, self.state.map.keyframes[-1]
        T_cam_last = se3.inverse(T_odom_cam) @ state.T_odom_cam
        step_covariance = se3.transform_covariance(T_cam_last, state.covariance) + covariance
        state.drift = se3.transform_covariance(T_cam_last, state.drift)
        if state.stereo_errors is not None or self.rig.line_time_s:
            state.velocities = () if state.lost_frames else add_step(state, view, T_odom_cam)
        state.T_last_cam, state.T_odom_cam = se3.inverse(T_cam_last), T_odom_cam
        state.covariance, state.lost_frames = covariance, 0
        state.odom_covariance = pose_covariance(keyframe, T_odom_cam, covariance)
        state.step_ns = view.frame.timestamp_ns - state.pose_ns
        state.pose_ns = view.frame.timestamp_ns
        T_keyframe_cam = se3.inverse(keyframe.T_odom_cam) @ T_odom_cam
        self._history.frames.append((state.pose_ns, keyframe.serial, T_keyframe_cam))
        return step_covariance
