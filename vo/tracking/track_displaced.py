"""Tracking of a view without features: a pose by halved images, then the landmarks themselves.

Most frames are a small motion from the last one. Landmarks that it observed are found again by
their displacement in images of half the size, which gives a pose to within a fraction of a pixel;
the map's landmarks are then aligned once, at their projections by it.
"""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import Pose
from vo.config import OdometrySettings
from vo.contract.arrays import Array, Indices, Mask, find_sorted
from vo.contract.observations import Observations
from vo.map.frame import Matches, View
from vo.map.local_map import TrackedFrame
from vo.map.state import TrackerState
from vo.tracking.association import (
    find_guided_matches,
    find_visible,
    in_view,
    project_landmarks,
    spread,
)
from vo.tracking.displaced_landmarks import NEAR_PX, find_displaced
from vo.tracking.hooked import replace_inliers, replace_matches
from vo.tracking.landmark_prior import sampling_weights
from vo.tracking.new_view import information_of, is_new_view, must_wait
from vo.tracking.pose_refinement import (
    find_consensus,
    refine_pose,
    select_inliers,
    weigh_consensus,
)
from vo.tracking.right_view import correct_cameras
from vo.tracking.smear import estimate_smear
from vo.tracking.tracked import Context, NotTracked, Tracked

MIN_KNOWN, MIN_KNOWN_NOISY, MIN_KNOWN_BURIED = 40, 60, 16
"""Observations in the previous frame; with fewer, features bring missed landmarks back. In noisy
images, which are smoothed, more are missed by chance. In those of very low SNR features are hardly
found twice."""

ROUGH_PX = 2.5
"""Inlier threshold of displacements in halved images."""


def track_displaced(
    state: TrackerState, previous: TrackedFrame, view: View, T_guess: Array, context: Context
) -> Tracked | NotTracked:
    """Search for landmarks of the previous frame near a predicted pose (4, 4), then further away.

    The first search fails fast; most predictions are better than its radius.
    """
    result: Tracked | NotTracked = NotTracked({"matches": 0, "inliers": 0})
    few = MIN_KNOWN_NOISY if view.smoothing_px else MIN_KNOWN
    few = MIN_KNOWN_BURIED if view.very_low_snr else few
    if len(previous.observations) < few or view.settings.motion.landmark_prior:
        return result  # the prior chooses among all landmarks, not among the last inliers
    for radius_px in (NEAR_PX, view.settings.matching.search_radius_px):
        with context.clock("matching"):
            matches = find_displaced(state.map, previous, view, T_guess, radius_px)
        if len(matches) >= view.settings.motion.min_inliers:
            result = _estimate(state, previous, view, T_guess, matches, context)
        if result.is_reliable:
            break
    return result


def _estimate(
    state: TrackerState, previous: TrackedFrame, view: View, T_guess: Array, matches: Matches,
    context: Context,
) -> Tracked | NotTracked:  # fmt: skip
    """Estimate the pose by displacements, then by some landmarks; by all where the view is new."""
    clock, settings, local_map = context.clock, view.settings, state.map
    counts, few = {"matches": len(matches), "inliers": 0}, settings.motion.min_inliers
    with clock("motion"):  # P3P under RANSAC (3.3)
        weights = sampling_weights(matches, state, view, T_guess)
        rough = replace(view, settings=_rough(settings, view.rig.f_px))
        consensus = find_consensus(matches, T_guess, weights, rough, context.rng)
        counts["consensus"] = 0 if consensus is None else int(consensus.inliers.sum())
        if consensus is None or counts["consensus"] < few:
            return NotTracked(counts)
        agreeing = matches.select(consensus.inliers)
        T_odom_cam = refine_pose(consensus.T_odom_cam, agreeing, view, is_rough=True).T_world_cam
    view = estimate_smear(state.map, previous, view, T_odom_cam)
    view = correct_cameras(state, view, T_odom_cam)  # by a better pose than the predicted one
    with clock("guided matching"):  # at their projections (F5)
        expected = project_landmarks(local_map.landmarks, T_odom_cam, view)
        known, worth = rank_landmarks(local_map.landmarks.ids, expected, previous.observations)
        visible, count = in_view(expected, view), settings.matching.landmarks_per_frame
        rows, count = np.flatnonzero(visible), context.budget.landmarks(count)
        tried = spread(rows, expected, known, count, settings, worth)
        found = find_visible(local_map, view, T_odom_cam, expected, tried, known)
    # What denies a pose by displacements would correct it most: a pose without it errs alike.
    views = replace(view, settings=rough.settings), view
    pose, found, inliers = refine_on_inliers(T_odom_cam, found, state, views, context)
    seen, ids = local_map.keyframes[-1].observations, local_map.landmarks.ids
    share = information_of(seen, ids[tried]) / max(information_of(seen, ids[rows]), 1e-9)
    waits = must_wait(state, pose.T_world_cam, view.rig)
    is_new = len(inliers) >= few and is_new_view(seen, inliers, settings, share, waits)
    if is_new:
        with clock("guided matching"):
            tried = rows
            found = find_guided_matches(local_map, view, pose.T_world_cam, found)
        pose, found, inliers = refine_on_inliers(pose.T_world_cam, found, state, (view,), context)
    counts["found"], counts["inliers"] = len(found), len(inliers)
    counts["motion iterations"] = pose.iterations
    if len(inliers) < few:
        return NotTracked(counts)
    covariance = weigh_consensus(pose, found, inliers, view)
    return Tracked(
        view, pose.T_world_cam, covariance, found, inliers, by_klt=False, tried=len(tried),
        is_new=is_new, counts=counts,
    )  # fmt: skip


def refine_on_inliers(
    T_odom_cam: Array, matches: Matches, state: TrackerState, views: tuple[View, ...],
    context: Context,
) -> tuple[Pose, Matches, Matches]:  # fmt: skip
    """Refine a pose on its inliers; with the matches, and those that agree with the result.

    The views are of one frame, with inlier thresholds that fall: one round of refinement by each.
    """
    *rough, view = views
    with context.clock("motion refinement"):  # of every frame (3.4)
        matches = replace_matches(context.hooks, matches, state.map, view)
        for wide in rough:
            inliers = _inliers(T_odom_cam, matches, wide, context)
            T_odom_cam = refine_pose(T_odom_cam, inliers, wide, is_rough=True).T_world_cam
        pose = refine_pose(T_odom_cam, _inliers(T_odom_cam, matches, view, context), view)
        return pose, matches, _inliers(pose.T_world_cam, matches, view, context)


def _inliers(T_odom_cam: Array, matches: Matches, view: View, context: Context) -> Matches:
    inliers = select_inliers(T_odom_cam, matches, view)
    return replace_inliers(context.hooks, view, matches, inliers)


def _rough(settings: OdometrySettings, f_px: float) -> OdometrySettings:
    """Raise the inlier threshold to that of displacements, if it is smaller."""
    threshold = max(settings.motion.threshold, ROUGH_PX / f_px)
    motion = settings.motion.model_copy(update={"threshold": threshold})
    return settings.model_copy(update={"motion": motion})


def rank_landmarks(ids: Indices, expected: Array, previous: Observations) -> tuple[Mask, Array]:
    """Return which landmarks (L,) a previous frame observed, and their worth for the translation.

    The worth is the disparity, by which the image moves, of projections (L, 3); of those observed,
    it is divided by the standard deviation of their pixel: its square is the information.
    """
    place = find_sorted(previous.ids, ids)
    known, worth = place >= 0, expected[:, 2].copy()
    worth[known] /= np.hypot(*previous.sigma_px[place[known], :2].T)
    return known, worth
