"""Relocalization after a loss: the pose of a view in the map that was lost (thesis 6, F1)."""

from dataclasses import dataclass, replace

import numpy as np

from vo.contract.arrays import Array
from vo.map.frame import View
from vo.map.local_map import LocalMap, empty_map, pose_covariance
from vo.tracking.association import find_guided_matches, find_matches
from vo.tracking.pose_refinement import find_consensus, refine_pose, select_inliers


@dataclass(frozen=True)
class RelocalizationThresholds:
    """Limits of the search, which starts without any prediction (decision 25)."""

    candidate_inliers: int = 6
    """Of matches from all over the image, most of them false: enough to try a pose."""
    threshold_scale: float = 3.0
    """Factor on the inlier threshold: points of two views disagree more than point and pixel."""
    confirming_inliers: int = 40
    """Landmarks that must then be found at their projections: twice what chance has not reached."""
    min_views: int = 3
    """Frames that must have observed a landmark for its map to be kept after a loss."""


LIMITS = RelocalizationThresholds()


def relocalize(
    lost_map: LocalMap | None, view: View, rng: np.random.Generator
) -> tuple[Array, Array] | None:
    """Find T_odom_cam (4, 4) of a view in a map that was lost, and its covariance (6, 6).

    Landmarks are matched all over the image, and points with points: absolute orientation needs
    no prediction. Landmarks that are then matched at their projections confirm the pose.
    """
    if lost_map is None:
        return None
    T_guess = lost_map.keyframes[-1].T_odom_cam
    matches = find_matches(lost_map, view, T_guess, float(max(view.frame.left.shape)))
    threshold = LIMITS.threshold_scale * view.settings.motion.threshold
    motion = view.settings.motion.model_copy(
        update={"method": "absolute", "residual": "reprojection", "threshold": threshold}
    )
    absolute = replace(view, settings=view.settings.model_copy(update={"motion": motion}))
    consensus = find_consensus(matches, T_guess, np.ones(len(matches)), absolute, rng)
    if consensus is None or consensus.inliers.sum() < LIMITS.candidate_inliers:
        return None
    matches = matches.select(consensus.inliers)
    pose = refine_pose(consensus.T_odom_cam, matches, view)
    for _ in range(2):
        matches = find_guided_matches(lost_map, view, pose.T_world_cam, matches)
        matches = select_inliers(pose.T_world_cam, matches, view)
        if len(matches) < LIMITS.candidate_inliers:
            return None
        pose = refine_pose(pose.T_world_cam, matches, view)
    if len(matches) < LIMITS.confirming_inliers:
        return None
    last = lost_map.keyframes[-1]
    return pose.T_world_cam, pose_covariance(last, pose.T_world_cam, pose.covariance)


def mark_lost(
    local_map: LocalMap, lost_map: LocalMap | None, lost_frames: int, patience_frames: int
) -> tuple[LocalMap, LocalMap | None]:
    """Return the map of the next frame, and the lost map, the first of those not yet merged.

    The map is kept for some lost frames, but for no more than it was observed by, then replaced by
    an empty one, and kept as the lost map. After a false start, where fewer than `min_views` frames
    observed it, it is dropped at once.
    """
    views = int(local_map.landmarks.views.max(initial=0))
    confirmed = views >= LIMITS.min_views
    kept_frames = min(patience_frames, views) if confirmed else 0
    if lost_frames <= kept_frames or not local_map.keyframes:
        return local_map, lost_map
    if confirmed:
        lost_map = lost_map or local_map
    return empty_map(local_map.next_serial, local_map.next_id), lost_map
