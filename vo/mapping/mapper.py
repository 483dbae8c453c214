"""The work that a new keyframe brings: its landmarks, and the adjustment of the map (thesis 3.4).

It is done in two steps at the start of the next two frames, which then take about as long as
others, or at once, if the keyframe came before the last one had its landmarks and adjustment. That
is by the number of frames, never by the clock: equal frames give equal poses on every machine.
"""

from dataclasses import replace

import numpy as np

from vo.calibration.self_calibration import SelfCalibration
from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.hooks import Hooks
from vo.map.frame import Matches, View
from vo.map.local_map import Keyframe, pose_covariance, renewed_map, transform_map
from vo.map.run_history import RunHistory
from vo.map.state import Pending, TrackerState
from vo.mapping.keyframes import add_keyframe
from vo.mapping.relocalization import relocalize
from vo.mapping.window_adjustment import adjuster
from vo.stereo.right_pixels import expect_right, find_right
from vo.tracking.diagnostics import add_row_offset
from vo.tracking.right_view import correct_cameras
from vo.tracking.tracked import Tracked


class Mapper:
    """Adds keyframes to the map of a tracker's state, and adjusts it."""

    def __init__(
        self, rig: StereoRig, settings: OdometrySettings, history: RunHistory,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._history, self._rng = history, rng
        self._adjust = adjuster(rig, settings.refinement)
        self.calibration = SelfCalibration(rig) if settings.self_calibration == "auto" else None

    def begin(self, state: TrackerState, tracked: Tracked) -> None:
        """Make a tracked view, the last one of the state, a keyframe; none is pending."""
        state.pending = Pending(
            tracked.view, tracked.inliers, tracked.covariance, tracked.T_odom_cam
        )

    def step(self, state: TrackerState, hooks: Hooks, counts: dict[str, int]) -> None:
        """Take the next step, if one is pending; count the iterations of an adjustment."""
        pending = state.pending
        if pending is None:
            return
        if pending.steps == 0:
            self._add(state, pending, hooks)
        elif pending.steps == 1:
            counts["structure iterations"] = self._adjust_map(state, pending)
        state.pending = replace(pending, steps=pending.steps + 1) if pending.has_work else None

    def finish(self, state: TrackerState, hooks: Hooks, counts: dict[str, int]) -> Array:
        """Take all pending steps; return how the last pose moved, (4, 4)."""
        T_odom_last = state.T_odom_cam
        while state.pending:
            self.step(state, hooks, counts)
        return se3.orthonormal(state.T_odom_cam @ se3.inverse(T_odom_last))

    def _add(self, state: TrackerState, pending: Pending, hooks: Hooks) -> None:
        """Add a keyframe with its new landmarks: features are detected now (3.2)."""
        inliers = pending.inliers.renew(state.map.landmarks)
        T_odom_cam = pending.T_odom_cam
        covariance = pose_covariance(state.map.keyframes[-1], T_odom_cam, pending.covariance)
        view = pending.view
        if self._calibrate(state, view, inliers):
            view = correct_cameras(state, view, state.T_odom_cam)
            state.map, inliers = renewed_map(state.map), None
        state.map = add_keyframe(state.map, view, T_odom_cam, covariance, inliers, hooks)
        keyframe, time_ns = state.map.keyframes[-1], view.frame.timestamp_ns
        if time_ns == state.pose_ns:
            state.previous = keyframe  # with its new landmarks
        self._history.record_keyframe(time_ns, keyframe.serial)

    def _calibrate(self, state: TrackerState, view: View, inliers: Matches) -> bool:
        """Take the inliers of a new keyframe for calibration; return whether the map is worn."""
        calibration = self.calibration
        if calibration is None or not calibration.gathers:
            return False
        is_worn = calibration.complete(self._history.velocity(calibration.time_ns))
        if calibration.errors != state.stereo_errors:
            state.stereo_errors, state.row_offsets_px = calibration.errors, ()
        seen = inliers.select(calibration.unused(inliers.ids, state.map.next_id))
        seen = seen.select(~np.isnan(seen.disparity_px))
        start = expect_right(view.frame, seen.pixels, seen.disparity_px)
        found = find_right(view.frame, seen.pixels, start, view.settings.stereo.align_px)
        calibration.add(view.frame.timestamp_ns, seen.pixels, found)
        return is_worn

    def _adjust_map(self, state: TrackerState, pending: Pending) -> int:
        """Adjust the map, and merge it with a lost one that the keyframe sees."""
        view, T_odom_keyframe = pending.view, state.map.keyframes[-1].T_odom_cam
        state.map, iterations = self._adjust(state.map)
        if found := relocalize(state.lost_map, view, self._rng):  # (6)
            T_odom_cam, covariance = found
            T_new_old = T_odom_cam @ se3.inverse(state.map.keyframes[-1].T_odom_cam)
            self._history.transform(state.map.keyframes[0].serial, T_new_old)
            state.map, state.lost_map = transform_map(state.map, T_new_old, covariance), None
        self._history.record_map(state.map, view.settings.refinement)
        state.row_offsets_px = add_row_offset(state.row_offsets_px, view, pending.inliers)
        T_new_old = state.map.keyframes[-1].T_odom_cam @ se3.inverse(T_odom_keyframe)
        state.T_odom_cam = se3.orthonormal(T_new_old @ state.T_odom_cam)
        state.drift = state.drift + _added_covariance(state.map.keyframes, state.T_odom_cam)
        if state.halt:
            T_halt = se3.orthonormal(T_new_old @ state.halt.T_odom_cam)
            state.halt = replace(state.halt, T_odom_cam=T_halt)
        return iterations


def _added_covariance(keyframes: tuple[Keyframe, ...], T_odom_cam: Array) -> Array:
    """Covariance (6, 6), in the frame of a camera (4, 4), that the newest keyframe added."""
    newest, none = keyframes[-1], np.zeros((6, 6))
    added = newest.covariance
    if len(keyframes) > 1:
        added = added - pose_covariance(keyframes[-2], newest.T_odom_cam, none)
    return se3.transform_covariance(se3.inverse(T_odom_cam) @ newest.T_odom_cam, added)
