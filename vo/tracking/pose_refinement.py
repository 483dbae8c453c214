"""Pose of a view from its matches: consensus, refinement and inliers (thesis 3.3, 3.4)."""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import Pose, refine_motion
from vo.contract.arrays import Array
from vo.contract.projection import project_points
from vo.features.image_quality import VERY_LOW_SNR
from vo.map.frame import Matches, View
from vo.pose.estimation import estimate_pose
from vo.pose.ransac import Consensus
from vo.stereo.rolling_shutter import shift_to_instant


def find_consensus(
    matches: Matches, T_odom_guess: Array, weights: Array, view: View, rng: np.random.Generator
) -> Consensus | None:
    """Estimate T_odom_cam from N matches with outliers, by `motion.method`.

    RANSAC uses the sampling weights (N,) and not the predicted pose (4, 4).
    """
    measured = measure_at_instant(T_odom_guess, matches, view)
    return estimate_pose(
        matches.points_odom,
        view.rig.normalized(measured[:, :2]),
        view.rig.triangulate(measured[:, :2], measured[:, 2]),
        view.settings.motion,
        rng,
        weights,
        T_odom_guess,
    )


def refine_pose(T_odom_cam: Array, matches: Matches, view: View, is_rough: bool = False) -> Pose:
    """Refine a pose on matches, with fixed landmarks; with `refinement.mode` none, keep it.

    The landmarks count by the error of their depth, unless the matches still hold outliers: an
    error of the depth would excuse them.
    """
    settings, measured = view.settings.refinement, measure_at_instant(T_odom_cam, matches, view)
    spread_odom = None if is_rough or settings.exact_landmarks else matches.spread_odom
    seen = matches.points_odom, measured, matches.sigma_px
    refined = refine_motion(T_odom_cam, *seen, view.rig, settings, spread_odom)
    if settings.mode == "none":
        return replace(refined, T_world_cam=T_odom_cam, iterations=0)
    return refined


def select_inliers(T_odom_cam: Array, matches: Matches, view: View) -> Matches:
    """Keep the matches whose reprojection error is below the inlier threshold (5.4)."""
    expected = project_points(matches.points_odom, T_odom_cam, view.rig)
    measured = measure_at_instant(T_odom_cam, matches, view)
    error_px = np.hypot(*(expected - measured)[:, :2].T)  # NaN behind the camera
    return matches.select(error_px < view.settings.motion.threshold * view.rig.f_px)


def measure_at_instant(T_odom_cam: Array, matches: Matches, view: View) -> Array:
    """Left-image u, v and disparity (N, 3) at the instant of the frame, at about a pose (4, 4)."""
    if view.velocity is None:
        return matches.measured
    return matches.measured + row_shift(T_odom_cam, matches, view)


def row_shift(T_odom_cam: Array, matches: Matches, view: View) -> Array:
    """Shift (N, 3) of matches to the instant of the frame, whose pose (4, 4) is about known.

    Where a disparity was not measured, it is the landmark's.
    """
    if view.velocity is None:
        return np.zeros((len(matches), 3))
    seen = matches.measured
    unknown = np.isnan(seen[:, 2])
    if unknown.any():
        expected = project_points(matches.points_odom[unknown], T_odom_cam, view.rig)
        seen[unknown, 2] = expected[:, 2]
    return shift_to_instant(seen, view.rig, view.velocity)


def weigh_consensus(pose: Pose, found: Matches, inliers: Matches, view: View) -> Array:
    """Covariance (6, 6) of a pose by inliers, which are a share of the landmarks found around it.

    Where others disagree, some of those that agree do so by chance, or move along: the inlier
    threshold cuts off the errors that would show it. The standard deviation grows as the share
    falls. Without guided matching, what disagrees is mostly false matches, which tell nothing.
    """
    share = len(inliers) / max(len(found), 1) if view.settings.matching.guided else 1.0
    covariance = pose.covariance / max(share, 1e-3) ** 2
    return VERY_LOW_SNR.variance * covariance if view.very_low_snr else covariance
