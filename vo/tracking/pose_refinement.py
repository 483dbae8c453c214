"""Where the camera is, by landmarks that were matched: consensus, refinement, who agrees."""

import numpy as np

from vo.bundle_adjustment.adjust import Pose, refine_motion
from vo.config import MotionSettings, OdometrySettings
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.pose.estimation import estimate_pose, reprojection_errors
from vo.pose.ransac import Consensus
from vo.tracking.association import Matches


def orient(
    matches: Matches,
    T_odom_guess: Array,
    weights: Array,
    rig: StereoRig,
    settings: OdometrySettings,
    rng: np.random.Generator,
) -> Consensus | None:
    """Estimate T_odom_cam with false matches among the good, by `motion.method`.

    Args:
        matches: Of landmarks with a view.
        T_odom_guess: (4, 4) expected pose; the orientations under RANSAC do without it.
        weights: (N,) how much each match counts there.
        rig: Projects.
        settings: Of motion.
        rng: Draws the samples.
    """
    return estimate_pose(
        matches.points_odom,
        rig.normalized(matches.pixels),
        rig.triangulate(matches.pixels, matches.measured[:, 2]),
        settings.motion,
        rng,
        weights,
        T_odom_guess,
    )


def refine_pose(
    T_odom_cam: Array, matches: Matches, rig: StereoRig, settings: OdometrySettings
) -> Pose:
    """Refine a pose on matches, the landmarks staying as they are; or keep it, if so set."""
    refined = refine_motion(
        T_odom_cam, matches.points_odom, matches.measured, matches.sigma, rig, settings.refinement
    )
    if settings.refinement.mode == "none":
        return Pose(T_odom_cam, refined.covariance, iterations=0)
    return refined


def agreeing(
    T_odom_cam: Array, matches: Matches, rig: StereoRig, settings: MotionSettings
) -> Matches:
    """Keep the matches that a pose explains to within the acceptance threshold (5.4)."""
    rays = rig.normalized(matches.pixels)
    errors = reprojection_errors(T_odom_cam, matches.points_odom, rays)
    return matches.select(errors < settings.threshold)
