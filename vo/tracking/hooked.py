"""Application of hooks: their answers replace the output of a stage, consistently.

A stage's output is passed as read-only views. It is returned as it is where there are no hooks.
"""

from dataclasses import replace

import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Indices
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import Matches, View
from vo.map.local_map import Landmarks, LocalMap
from vo.stereo.sparse import UNREFINED_SIGMA_PX, Disparities, measure_disparities

SAME_PX = 1e-9
"""A pixel that moved less was not replaced."""


def _read_only(array: Array) -> Array:
    view = array.view()
    view.flags.writeable = False
    return view


def _frame(frame: StereoFrame) -> StereoFrame:
    return replace(frame, left=_read_only(frame.left), right=_read_only(frame.right))


def _writable(answer: Array) -> Array:
    return answer if answer.flags.writeable else answer.copy()


def replace_features(hooks: Hooks, frame: StereoFrame, pixels: Array) -> Array:
    """Replace features (N, 2)."""
    if hooks is NO_HOOKS:
        return pixels
    return _writable(hooks.features(_frame(frame), _read_only(pixels)))


def announce_landmarks(hooks: Hooks, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
    """Tell hooks of new landmarks (N,) at pixels (N, 2)."""
    if hooks is not NO_HOOKS:
        hooks.new_landmarks(_frame(frame), _read_only(ids), _read_only(pixels))


def replace_prediction(
    hooks: Hooks, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
) -> Array:
    """Replace the predicted pose (4, 4)."""
    if hooks is NO_HOOKS:
        return T_odom_cam
    poses = _read_only(T_odom_last), _read_only(T_odom_cam)
    return _writable(hooks.predicted_pose(_frame(frame), last_ns, *poses))


def replace_disparities(
    hooks: Hooks, frame: StereoFrame, pixels: Array, found: Disparities, settings: StereoSettings
) -> Disparities:
    """Replace disparities at (N, 2) pixels; the depth gate holds for them too."""
    if hooks is NO_HOOKS:
        return found
    values_px = hooks.disparity(_frame(frame), _read_only(pixels), _read_only(found.values_px))
    known = values_px > settings.min_disparity_px  # not NaN
    sigma_px = np.where(np.isnan(found.sigma_px), UNREFINED_SIGMA_PX, found.sigma_px)
    return replace(
        found,
        values_px=np.where(known, values_px, np.nan),
        sigma_px=np.where(known, sigma_px, np.nan),
    )


def replace_matches(hooks: Hooks, matches: Matches, local_map: LocalMap, view: View) -> Matches:
    """Replace the pixels of the map's landmarks, and the disparities there.

    Where a pixel is replaced, the disparity is measured anew; there is no feature or correlation.
    """
    if hooks is NO_HOOKS:
        return matches
    landmarks, frame, s = local_map.landmarks, _frame(view.frame), view.settings
    found = np.full((len(landmarks), 2), np.nan)
    found[matches.rows] = matches.pixels
    pixels = hooks.pixels(frame, _read_only(landmarks.ids), _read_only(found))
    kept = np.abs(pixels - found).max(axis=1) < SAME_PX
    moved = np.flatnonzero(~np.isnan(pixels[:, 0]) & ~kept)
    measured = _measure(view, landmarks, moved, pixels[moved])
    matches = matches.select(kept[matches.rows]).merge(measured)

    disparity_px = _read_only(matches.disparity_px)
    values_px = hooks.disparity(frame, _read_only(matches.pixels), disparity_px)
    usable = values_px > s.stereo.min_disparity_px  # not NaN
    sigma_px, unknown = matches.sigma_px.copy(), np.isnan(matches.sigma_px[:, 2])
    sigma_px[unknown, 2] = np.hypot(UNREFINED_SIGMA_PX, s.refinement.sigma_disparity_px)
    sigma_px[~usable, 2] = np.nan
    return replace(matches, disparity_px=np.where(usable, values_px, np.nan), sigma_px=sigma_px)


def _measure(view: View, landmarks: Landmarks, rows: Indices, pixels: Array) -> Matches:
    """Match landmarks at given pixels (N, 2), with the disparities there."""
    slopes, s = landmarks.anchor_slopes[rows], view.settings.refinement
    found = measure_disparities(view.frame, view.dense, pixels, view.settings.stereo, slopes=slopes)
    pixel_sigma = np.full((len(pixels), 2), s.sigma_px)
    sigma_px = np.column_stack([pixel_sigma, np.hypot(found.sigma_px, s.sigma_disparity_px)])
    return Matches.of(landmarks, rows, pixels, found.values_px, sigma_px)


def replace_inliers(hooks: Hooks, view: View, matches: Matches, inliers: Matches) -> Matches:
    """Replace the inliers among matches."""
    if hooks is NO_HOOKS:
        return inliers
    columns = matches.ids, matches.pixels, np.isin(matches.ids, inliers.ids)
    return matches.select(hooks.inliers(_frame(view.frame), *map(_read_only, columns)))
