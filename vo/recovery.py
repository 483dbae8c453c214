"""After a loss: where a new segment lies in the map of the old one (thesis 6, F1)."""

import numpy as np

from vo.config import OdometrySettings
from vo.contract.rig import StereoRig
from vo.correspondence import find_matches
from vo.localisation import orient, refine_pose
from vo.refine import Pose
from vo.tracks import LocalMap
from vo.view import View

ADRIFT = 1.0
"""Variance, m² and rad², of the pose of a segment that nothing connects to what went before."""

STITCHING_INLIERS = 20
"""A false connection would be worse than none."""

STITCHING_SHARE = 0.4
"""Of the matches that must agree."""


def find_again(
    lost_map: LocalMap,
    view: View,
    rig: StereoRig,
    settings: OdometrySettings,
    rng: np.random.Generator,
) -> Pose | None:
    """Locate a view in a map that was lost, with no idea of where it might be.

    Landmarks are matched all over the image, and points with points: absolute orientation needs
    no guess and no second view.

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
    motion = settings.motion.model_copy(update={"method": "absolute", "residual": "reprojection"})
    consensus = orient(matches, rig, motion, rng)
    if consensus is None:
        return None
    agreed = matches.select(consensus.inliers)
    if len(agreed) < max(STITCHING_INLIERS, STITCHING_SHARE * len(matches)):
        return None
    return refine_pose(consensus.T, agreed, rig, settings)
