"""Tracking of a view in the local map: match, estimate the pose, refine it (thesis 3.2-3.4)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.features.image_quality import adapt_to_blur
from vo.hooks import Hooks
from vo.map.frame import Matches, View
from vo.map.state import TrackedFrame, TrackerState
from vo.tracking import association
from vo.tracking.diagnostics import images_look_swapped
from vo.tracking.hooked import replace_inliers, replace_matches, replace_prediction
from vo.tracking.klt import track_klt
from vo.tracking.landmark_prior import sampling_weights
from vo.tracking.motion_model import predict_motion
from vo.tracking.new_view import is_new_view, must_wait
from vo.tracking.pose_refinement import (
    find_consensus,
    refine_pose,
    select_inliers,
    weigh_consensus,
)
from vo.tracking.rotation_prior import align_rotation
from vo.tracking.smear import estimate_smear
from vo.tracking.stationary import encoders_at_rest
from vo.tracking.tracked import Context, NotTracked, Tracked


@dataclass(frozen=True)
class RetryThresholds:
    """When a pose is accepted; docs/decisions/0022 has the drives on which they were chosen."""

    min_match_ratio: float = 0.85
    """Inliers over matches of templates above which KLT may confirm a pose."""
    min_klt_ratio: float = 0.5
    """Landmarks tracked by KLT that must then agree with the pose."""
    klt_weight: float = 0.5
    """Of a landmark tracked by KLT, beside one matched by its template."""
    max_mono_ratio: float = 0.7
    """Inliers without disparity above which the right image may show something else."""


LIMITS = RetryThresholds()


def predict_pose(state: TrackerState, view: View, hooks: Hooks) -> Array:
    """Predict T_odom_cam (4, 4): constant velocity, or at rest where the encoders say so."""
    moving = view.settings.matching.motion_model == "constant_velocity"
    moving = moving and not encoders_at_rest(state.halt, view)
    T_guess = state.T_odom_cam @ (predict_motion(state, view.frame) if moving else np.eye(4))
    return replace_prediction(hooks, view.frame, state.pose_ns, state.T_odom_cam, T_guess)


def track_local_map(
    state: TrackerState, view: View, T_guess: Array, context: Context,
    radius_px: float | None = None,
) -> Tracked | NotTracked:  # fmt: skip
    """Match landmarks near their projections by a predicted pose (4, 4), and estimate the pose."""
    radius_px = radius_px or view.settings.matching.search_radius_px
    with context.clock("matching"):  # mutual nearest neighbours by ZNCC, alignment (3.2)
        matches = association.find_matches(state.map, view, T_guess, radius_px)
    return _estimate(state, view, T_guess, matches, context)


@dataclass(frozen=True, eq=False)
class _Turned:
    """Searches from the last frame, turned by a rotation prior; each is made at most once."""

    state: TrackerState
    last: TrackedFrame
    view: View
    T_guess: Array
    context: Context

    @cached_property
    def T_odom_cam(self) -> Array:
        """The prediction (4, 4) with the rotation by which the whole images align."""
        step = se3.inverse(self.state.T_odom_cam) @ self.T_guess
        with self.context.clock("rotation prior"):
            left, now, R_guess = self.last.left, self.view.frame.left, step[:3, :3]
            step[:3, :3] = align_rotation(left, now, self.view.rig, R_guess)
        return self.state.T_odom_cam @ step

    @cached_property
    def by_klt(self) -> Tracked | NotTracked:
        """The pose by the observations of the last frame, tracked into this one."""
        s = self.view.settings
        blurred = replace(self.view, settings=s if self.view.is_smeared else adapt_to_blur(s))
        T_turned = self.T_odom_cam
        with self.context.clock("KLT"):
            matches = track_klt(self.last, self.state.map, blurred, T_turned)
        return _estimate(self.state, blurred, T_turned, matches, self.context, by_klt=True)


def search_pose(
    state: TrackerState, view: View, T_guess: Array, first: Tracked | NotTracked, context: Context
) -> Tracked | NotTracked:
    """Try other searches after the first until a pose is reliable; return the best (decision 22).

    Near the prediction, near a rotation prior, by KLT from the previous frame, and a wide search
    without prediction. Between them, KLT may confirm the best pose.
    """
    settings, last, turned = view.settings.matching, state.previous, None
    if last and not first.is_reliable:
        view = estimate_smear(state.map, last, view, T_guess)
    if settings.min_inlier_ratio and last:
        turned = _Turned(state, last, view, T_guess, context)

    def near(T_near: Array, radius_px: float | None = None) -> Tracked | NotTracked:
        return track_local_map(state, view, T_near, context, radius_px)

    searches = [lambda: near(T_guess)]
    if turned:
        searches += [lambda: near(turned.T_odom_cam), lambda: turned.by_klt]
    searches += [lambda: near(state.T_odom_cam, settings.max_search_radius_px)]
    attempts, best = [first], first if isinstance(first, Tracked) else None
    for search in searches:
        if best and (best.is_reliable or context.budget.is_spent()):
            break
        if best and turned and _is_consistent(best) and _confirms(turned.by_klt, best):
            break
        attempts.append(attempt := search())
        if isinstance(attempt, Tracked):
            best = max(attempt, best, key=_score) if best else attempt
    return best or max(attempts, key=lambda attempt: attempt.counts["inliers"])


def _score(attempt: Tracked) -> float:
    return len(attempt.inliers) * (LIMITS.klt_weight if attempt.by_klt else 1.0)


def _is_consistent(best: Tracked) -> bool:
    return not best.by_klt and len(best.inliers) >= LIMITS.min_match_ratio * len(best.matches)


def _confirms(klt: Tracked | NotTracked, best: Tracked) -> bool:
    """Whether KLT agrees with a pose by templates, which warp with the surface and are exact."""
    if isinstance(klt, NotTracked):
        return False
    same = select_inliers(best.T_odom_cam, klt.inliers, klt.view)
    return len(same) >= LIMITS.min_klt_ratio * len(klt.inliers)


def shows_swapped_images(tracked: Tracked, view: View) -> bool:
    """Whether hardly an inlier has a disparity, and the images look exchanged."""
    mono = np.isnan(tracked.inliers.disparity_px).mean() > LIMITS.max_mono_ratio
    return bool(mono) and images_look_swapped(view)


def _estimate(
    state: TrackerState, view: View, T_guess: Array, matches: Matches, context: Context,
    by_klt: bool = False,
) -> Tracked | NotTracked:  # fmt: skip
    """Estimate the pose by matches; RANSAC, refinement, guided matching, refinement."""
    clock, hooks, min_inliers = context.clock, context.hooks, view.settings.motion.min_inliers

    def verified(matches: Matches) -> Matches:
        if view.settings.matching.circular_check and state.previous:
            keep = association.is_consistent(matches, state.map.landmarks, state.previous, view)
            matches = matches.select(keep)
        return replace_matches(hooks, matches, state.map, view)

    def inliers_of(T_odom_cam: Array, matches: Matches) -> Matches:
        return replace_inliers(hooks, view, matches, select_inliers(T_odom_cam, matches, view))

    with clock("matching"):
        matches = verified(matches)
        counts = {"matches": len(matches), "inliers": 0}
    with clock("motion"):  # P3P under RANSAC (3.3)
        weights = sampling_weights(matches, state, view, T_guess)
        consensus = find_consensus(matches, T_guess, weights, view, context.rng)
        if consensus is None:
            return NotTracked(counts)
        inliers = replace_inliers(hooks, view, matches, matches.select(consensus.inliers))
        counts["consensus"] = counts["inliers"] = len(inliers)
        if len(inliers) < min_inliers:
            return NotTracked(counts)
    with clock("motion refinement"):  # of every frame (3.4)
        guided = view.settings.matching.guided and not by_klt
        pose = refine_pose(consensus.T_odom_cam, inliers, view, is_rough=guided)
        counts["motion iterations"] = pose.iterations
    if guided:
        with clock("guided matching"):  # the other landmarks, at their projections (F5)
            matches = association.find_guided_matches(state.map, view, pose.T_world_cam, matches)
            matches = verified(matches)
            pose = refine_pose(pose.T_world_cam, inliers_of(pose.T_world_cam, matches), view)
            counts["motion iterations"] += pose.iterations
    inliers = inliers_of(pose.T_world_cam, matches)
    counts["found"], counts["inliers"] = len(matches), len(inliers)
    if len(inliers) < min_inliers:
        return NotTracked(counts)
    expected = association.project_landmarks(state.map.landmarks, pose.T_world_cam, view)
    last = state.map.keyframes[-1].observations
    waits = must_wait(state, pose.T_world_cam, view.rig)
    covariance = weigh_consensus(pose, matches, inliers, view)
    return Tracked(
        view, pose.T_world_cam, covariance, matches, inliers, by_klt,
        tried=int(association.in_view(expected, view).sum()),
        is_new=is_new_view(last, inliers, view.settings, waits=waits), counts=counts,
    )  # fmt: skip
