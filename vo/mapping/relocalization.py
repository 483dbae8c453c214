"""After a loss: where a new segment lies in the map of the old one (thesis 6, F1)."""

import numpy as np

from vo.bundle_adjustment.adjust import Pose
from vo.config import OdometrySettings
from vo.contract.rig import StereoRig
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.tracking.association import find_matches, find_more
from vo.tracking.pose_refinement import agreeing, orient, refine_pose

ADRIFT = 1.0
"""Variance, m² and rad², of the pose of a segment that nothing connects to what went before."""

CANDIDATE_INLIERS = 6
"""Of matches from all over the image, most of them false: enough to try a pose."""

LOOSE = 3.0
"""Points of two single views disagree by more than a point and a pixel do."""

CONFIRMED = 40
"""Landmarks that must then be found just where the pose puts them: chance does not do that."""


def find_again(
    lost_map: LocalMap,
    view: View,
    rig: StereoRig,
    settings: OdometrySettings,
    rng: np.random.Generator,
) -> Pose | None:
    """Locate a view in a map that was lost, with no idea of where it might be.

    Landmarks are matched all over the image, and points with points: absolute orientation needs
    no guess. Landmarks that are then found where that pose puts them confirm it.

    Args:
        lost_map: Its landmarks still have their appearance and templates.
        view: A keyframe of the new segment.
        rig: Triangulates.
        settings: Of matching; the orientation is absolute whatever they say.
        rng: Draws the samples.
    """
    everywhere = float(max(view.frame.left.shape))
    T_guess = lost_map.keyframes[-1].T_odom_cam
    matches = find_matches(lost_map, view, T_guess, everywhere, rig, settings)
    motion = settings.motion.model_copy(
        update={
            "method": "absolute",
            "residual": "reprojection",
            "threshold": LOOSE * settings.motion.threshold,
        }
    )
    absolute = settings.model_copy(update={"motion": motion})
    consensus = orient(matches, T_guess, np.ones(len(matches)), rig, absolute, rng)
    if consensus is None or consensus.inliers.sum() < CANDIDATE_INLIERS:
        return None
    matches = matches.select(consensus.inliers)
    pose = refine_pose(consensus.T_odom_cam, matches, rig, settings)
    for _ in range(2):
        matches = find_more(lost_map, view, pose.T_world_cam, matches, rig, settings)
        matches = agreeing(pose.T_world_cam, matches, rig, settings.motion)
        if len(matches) < CANDIDATE_INLIERS:
            return None
        pose = refine_pose(pose.T_world_cam, matches, rig, settings)
    return pose if len(matches) >= CONFIRMED else None
