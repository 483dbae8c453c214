"""The camera's pose from 3D-2D matches: P3P under RANSAC (thesis 3.3)."""

import numpy as np

from vo.config import MotionSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.p3p import solve_p3p
from vo.ransac import Consensus, ransac


def relative_orientation(
    points_odom: Array, rays: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    """Estimate T_odom_cam from landmarks and where the left camera sees them.

    Args:
        points_odom: (N, 3) metres.
        rays: (N, 2) normalised image coordinates (x / z, y / z).
        settings: RANSAC's.
        rng: Draws the samples.

    Returns:
        T_odom_cam and its inliers, or None if fewer than three matches or all degenerate.
    """
    homogeneous = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    unit = homogeneous / np.linalg.norm(homogeneous, axis=1, keepdims=True)

    def solve(samples: Indices) -> Array:
        return solve_p3p(points_odom[samples], unit[samples])[0]

    def residuals(T_odom_cam: Array) -> Array:
        return reprojection_errors(T_odom_cam, points_odom, rays)

    return ransac(len(rays), solve, residuals, settings, rng)


def reprojection_errors(T_odom_cam: Array, points_odom: Array, rays: Array) -> Array:
    """Distance in normalised image coordinates: (..., 4, 4), (N, 3), (N, 2) to (..., N).

    NaN for points that are not in front of the camera.
    """
    points_cam = se3.transform(se3.inverse(T_odom_cam), points_odom)
    z = points_cam[..., 2:]
    seen = np.divide(
        points_cam[..., :2], z, out=np.full_like(points_cam[..., :2], np.nan), where=z > 0
    )
    return np.linalg.norm(seen - rays, axis=-1)
