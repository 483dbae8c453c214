"""Pose of a view from its matches: consensus, refinement and inliers (thesis 3.3, 3.4)."""

import numpy as np

from vo.bundle_adjustment.adjust import Pose, refine_motion
from vo.contract.arrays import Array
from vo.contract.projection import project_points
from vo.map.frame import Matches, View
from vo.pose.estimation import estimate_pose
from vo.pose.ransac import Consensus


def find_consensus(
    matches: Matches, T_odom_guess: Array, weights: Array, view: View, rng: np.random.Generator
) -> Consensus | None:
    """Estimate T_odom_cam from N matches with outliers, by `motion.method`.

    RANSAC uses the sampling weights (N,) and not the predicted pose (4, 4).
    """
    return estimate_pose(
        matches.points_odom,
        view.rig.normalized(matches.pixels),
        view.rig.triangulate(matches.pixels, matches.disparity_px),
        view.settings.motion,
        rng,
        weights,
        T_odom_guess,
    )


def refine_pose(T_odom_cam: Array, matches: Matches, view: View) -> Pose:
    """Refine a pose on matches, with fixed landmarks; with `refinement.mode` none, keep it."""
    settings = view.settings.refinement
    refined = refine_motion(
        T_odom_cam, matches.points_odom, matches.measured, matches.sigma_px, view.rig, settings
    )
    if settings.mode == "none":
        return Pose(T_odom_cam, refined.covariance, iterations=0)
    return refined


def select_inliers(T_odom_cam: Array, matches: Matches, view: View) -> Matches:
    """Keep the matches whose reprojection error is below the inlier threshold (5.4)."""
    expected = project_points(matches.points_odom, T_odom_cam, view.rig)
    error_px = np.hypot(*(expected[:, :2] - matches.pixels).T)  # NaN behind the camera
    return matches.select(error_px < view.settings.motion.threshold * view.rig.f_px)
