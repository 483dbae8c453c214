"""Putting what hooks return in the place of what a stage found, consistently."""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings, StereoSettings
from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.features.detector import Features
from vo.hooks import UNTOUCHED, Hooks
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.patches.zncc import describe
from vo.stereo.sparse import UNREFINED_SIGMA_PX, Disparities, measure_disparities
from vo.tracking.association import Matches

UNKNOWN = -1
"""In the place of a whole number, such as the row of a feature that does not exist."""

SAME_PX = 1e-9
"""A pixel that moved less was not replaced."""


def replace_features(hooks: Hooks, view: View, settings: OdometrySettings) -> View:
    """Ask for other features, and describe them."""
    if hooks is UNTOUCHED:
        return view
    pixels = hooks.features(view.frame, view.features.pixels)
    vectors = describe(view.frame.left, pixels, settings.matching.patch_px)
    return replace(view, features=Features(pixels), vectors=vectors)


def replace_disparities(
    hooks: Hooks, frame: StereoFrame, pixels: Array, found: Disparities, settings: StereoSettings
) -> Disparities:
    """Ask for other disparities at (N, 2) pixels; the depth gate holds for them too."""
    if hooks is UNTOUCHED:
        return found
    values_px = hooks.disparity(frame, pixels, found.values_px)
    known = values_px > settings.min_disparity_px  # not NaN
    sigma_px = np.where(np.isnan(found.sigma_px), UNREFINED_SIGMA_PX, found.sigma_px)
    return Disparities(
        np.where(known, values_px, np.nan), np.where(known, sigma_px, np.nan), found.slopes
    )


def replace_matches(
    hooks: Hooks,
    matches: Matches,
    local_map: LocalMap,
    view: View,
    settings: OdometrySettings,
) -> Matches:
    """Ask for other pixels of the map's landmarks, and for other disparities there.

    A landmark whose pixel is replaced keeps its appearance, and its disparity is measured anew.
    Its feature is UNKNOWN, and its likeness NaN.

    Args:
        hooks: Whom to ask.
        matches: Found.
        local_map: Whose landmarks may be matched.
        view: The frame.
        settings: Of stereo and of the noise.
    """
    if hooks is UNTOUCHED:
        return matches
    landmarks, frame = local_map.landmarks, view.frame
    found = np.full((len(landmarks), 2), np.nan)
    found[matches.rows] = matches.pixels
    pixels = hooks.pixels(frame, landmarks.ids, found)
    known = ~np.isnan(pixels[:, 0])
    kept = np.abs(pixels - found).max(axis=1) < SAME_PX
    fresh = np.flatnonzero(known & ~kept)
    every = _spread(matches.select(kept[matches.rows]), len(landmarks))
    measured, sigma = every["measured"], every["sigma"]
    measured[fresh], sigma[fresh] = _measure(
        view, pixels[fresh], landmarks.anchor_slopes[fresh], settings
    )

    values_px = hooks.disparity(frame, measured[known, :2], measured[known, 2])
    usable = values_px > settings.stereo.min_disparity_px  # not NaN
    unjudged = np.hypot(UNREFINED_SIGMA_PX, settings.refinement.sigma_disparity_px)
    sigma_px = np.where(np.isnan(sigma[known, 2]), unjudged, sigma[known, 2])
    measured[known, 2] = np.where(usable, values_px, np.nan)
    sigma[known, 2] = np.where(usable, sigma_px, np.nan)
    every["rows"] = np.arange(len(landmarks))
    every["ids"], every["points_odom"] = landmarks.ids, landmarks.points_odom
    return Matches(**every).select(known)


def replace_inliers(hooks: Hooks, view: View, matches: Matches, agreed: Matches) -> Matches:
    """Ask which matches are right, given those that agree with a motion."""
    if hooks is UNTOUCHED:
        return agreed
    agree = np.isin(matches.ids, agreed.ids)
    return matches.select(hooks.inliers(view.frame, matches.ids, matches.pixels, agree))


def _spread(matches: Matches, n: int) -> dict[str, Array]:
    """Columns of the matches for each of n landmarks; UNKNOWN or NaN for those without."""
    columns: dict[str, Array] = {}
    for name, values in vars(matches).items():
        nothing = UNKNOWN if values.dtype.kind == "i" else np.nan
        columns[name] = np.full((n, *values.shape[1:]), nothing, values.dtype)
        columns[name][matches.rows] = values
    return columns


def _measure(
    view: View, pixels: Array, slopes: Array, settings: OdometrySettings
) -> tuple[Array, Array]:
    """Measurements (N, 3) at given pixels, and their standard deviations."""
    found = measure_disparities(view.frame, view.dense, pixels, settings.stereo, slopes=slopes)
    s = settings.refinement
    pixel_sigma = np.full((len(pixels), 2), s.sigma_px)
    sigma = np.column_stack([pixel_sigma, np.hypot(found.sigma_px, s.sigma_disparity_px)])
    return np.column_stack([pixels, found.values_px]), sigma
