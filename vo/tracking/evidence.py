"""What speaks against a pose: how unsure its step is, and whether its start was confirmed."""

import math

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig
from vo.map.frame import Matches
from vo.tracking.tracked import Tracked

STEP_SHARE = 0.02
"""Standard deviation of a step over its length that is no weakness, however long it is."""

BURIED_SHARE = 0.67
"""Factor on the largest standard deviations of steps in images of very low SNR, where many are near
them: a third of what counts as wrong, instead of half."""

MIN_CONFIRMED = 0.5
"""Landmarks of one view that a second must find, of those it looks for: until there is another
keyframe, they rest on a single pair of images."""

CONFIRMED = 100
"""Landmarks found again that confirm a start, however many were looked for."""

UNSEEN_PX = 0.05
"""Motion of landmarks in the image, std. dev., that a start does not tell from the camera's own."""

MIN_AGREEMENT = 0.8
"""Inliers over landmarks found below which their disagreement is given as the reason."""


def disagreement(T_ref_claimed: Array, T_ref_measured: Array) -> Array:
    """Covariance (6, 6) that a claimed pose (4, 4) has beyond that of what was measured of it."""
    apart = se3.log_small(se3.inverse(T_ref_claimed) @ T_ref_measured)
    return np.outer(apart, apart)


def start_covariance(inliers: Matches, rig: StereoRig) -> Array:
    """Covariance (6, 6) that steps have, beside that of the images, until the second keyframe.

    Most of what a first view sees may begin to move with the camera, as a crowd. As long as that is
    below the noise of a pixel, all landmarks agree with a part of the motion.
    """
    covariance = np.zeros((6, 6))
    disparity_px = inliers.disparity_px[~np.isnan(inliers.disparity_px)]
    if len(disparity_px):
        sigma_m = UNSEEN_PX * rig.baseline_m / float(np.median(disparity_px))
        covariance[:3, :3] = sigma_m**2 * np.eye(3)
    return covariance


def explain_weak_step(
    T_last_cam: Array, step_covariance: Array, moved: Array, tracked: Tracked, is_start: bool,
    settings: OdometrySettings,
) -> str:  # fmt: skip
    """Say why the step (4, 4) to a tracked frame is weak: its covariance (6, 6); empty if it isn't.

    A part (6, 6) of the covariance is by what the map moved since the last frame.
    """
    s, inliers = settings.motion, len(tracked.inliers)
    if s.weak_step_m == 0:
        return ""
    if is_start and inliers < min(CONFIRMED, MIN_CONFIRMED * tracked.tried):
        return f"start not confirmed: {inliers} of {tracked.tried} landmarks found again"
    sigma_m, sigma_rad = _largest(step_covariance)
    limit_m = max(s.weak_step_m, STEP_SHARE * math.hypot(*T_last_cam[:3, 3].tolist()))
    sigma_deg, share = math.degrees(sigma_rad), BURIED_SHARE if tracked.view.very_low_snr else 1.0
    if sigma_m <= share * limit_m and sigma_deg <= share * s.weak_step_deg:
        return ""
    reason = f"step uncertain by {1e3 * sigma_m:.1f} mm, {sigma_deg:.2f}°"
    moved_m, moved_rad = _largest(moved)
    if moved_m > sigma_m / 2 or moved_rad > sigma_rad / 2:
        moved_deg = math.degrees(moved_rad)
        return f"{reason}: the map was corrected by {1e3 * moved_m:.1f} mm, {moved_deg:.2f}°"
    found = len(tracked.matches)
    if inliers < MIN_AGREEMENT * found:
        return f"{reason}: {inliers} of {found} landmarks agree"
    return reason


@compiled()
def _largest(covariance: Array) -> tuple[float, float]:
    """Largest standard deviations of a covariance (6, 6), of translation and of rotation."""
    metres2 = np.linalg.eigvalsh(covariance[:3, :3].copy())[-1]
    radians2 = np.linalg.eigvalsh(covariance[3:, 3:].copy())[-1]
    return np.sqrt(max(metres2, 0.0)), np.sqrt(max(radians2, 0.0))
