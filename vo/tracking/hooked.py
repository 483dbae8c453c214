"""Application of hooks: their answers replace the output of a stage, consistently.

A stage's output is passed as read-only views. It is returned as it is where there are no hooks.
"""

from dataclasses import replace

import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Indices
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.map.matches import NO_FEATURE, Matches
from vo.patches.zncc import describe
from vo.stereo.sparse import UNREFINED_SIGMA_PX, Disparities, measure_disparities

SAME_PX = 1e-9
"""A pixel that moved less was not replaced."""


def read_only(array: Array) -> Array:
    """Make a view that cannot be written into."""
    view = array.view()
    view.flags.writeable = False
    return view


def _frame(frame: StereoFrame) -> StereoFrame:
    return replace(frame, left=read_only(frame.left), right=read_only(frame.right))


def _own(answer: Array) -> Array:
    """An answer that can be written into."""
    return answer if answer.flags.writeable else answer.copy()


def replace_features(hooks: Hooks, view: View) -> View:
    """Replace features, and describe them."""
    if hooks is NO_HOOKS:
        return view
    pixels = _own(hooks.features(_frame(view.frame), read_only(view.features)))
    descriptors = describe(view.frame.left, pixels, view.settings.matching.patch_px)
    return replace(view, features=pixels, descriptors=descriptors)


def announce_landmarks(hooks: Hooks, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
    """Tell hooks of new landmarks (N,) at pixels (N, 2)."""
    if hooks is not NO_HOOKS:
        hooks.new_landmarks(_frame(frame), read_only(ids), read_only(pixels))


def replace_prediction(
    hooks: Hooks, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
) -> Array:
    """Replace the predicted pose (4, 4)."""
    if hooks is NO_HOOKS:
        return T_odom_cam
    poses = read_only(T_odom_last), read_only(T_odom_cam)
    return _own(hooks.predicted_pose(_frame(frame), last_ns, *poses))


def replace_disparities(
    hooks: Hooks, frame: StereoFrame, pixels: Array, found: Disparities, settings: StereoSettings
) -> Disparities:
    """Replace disparities at (N, 2) pixels; the depth gate holds for them too."""
    if hooks is NO_HOOKS:
        return found
    values_px = hooks.disparity(_frame(frame), read_only(pixels), read_only(found.values_px))
    known = values_px > settings.min_disparity_px  # not NaN
    sigma_px = np.where(np.isnan(found.sigma_px), UNREFINED_SIGMA_PX, found.sigma_px)
    return Disparities(
        np.where(known, values_px, np.nan), np.where(known, sigma_px, np.nan), found.slopes
    )


def replace_matches(hooks: Hooks, matches: Matches, local_map: LocalMap, view: View) -> Matches:
    """Replace the pixels of the map's landmarks, and the disparities there.

    Where a pixel is replaced, the disparity is measured anew; there is no feature or correlation.
    """
    if hooks is NO_HOOKS:
        return matches
    landmarks, frame = local_map.landmarks, view.frame
    found = np.full((len(landmarks), 2), np.nan)
    found[matches.rows] = matches.pixels
    pixels = hooks.pixels(_frame(frame), read_only(landmarks.ids), read_only(found))
    known = ~np.isnan(pixels[:, 0])
    kept = np.abs(pixels - found).max(axis=1) < SAME_PX
    moved = np.flatnonzero(known & ~kept)
    every = _by_landmark(matches.select(kept[matches.rows]), len(landmarks))
    measured = np.column_stack([every["pixels"], every["disparity_px"]])
    sigma = every["sigma_px"]
    measured[moved], sigma[moved] = _measure(view, pixels[moved], landmarks.anchor_slopes[moved])

    places, disparity_px = measured[known, :2], measured[known, 2]
    values_px = hooks.disparity(_frame(frame), read_only(places), read_only(disparity_px))
    usable = values_px > view.settings.stereo.min_disparity_px  # not NaN
    unrefined = np.hypot(UNREFINED_SIGMA_PX, view.settings.refinement.sigma_disparity_px)
    sigma_px = np.where(np.isnan(sigma[known, 2]), unrefined, sigma[known, 2])
    measured[known, 2] = np.where(usable, values_px, np.nan)
    sigma[known, 2] = np.where(usable, sigma_px, np.nan)
    every |= {
        "rows": np.arange(len(landmarks)),
        "ids": landmarks.ids,
        "points_odom": landmarks.points_odom,
        "pixels": measured[:, :2],
        "disparity_px": measured[:, 2],
    }
    return Matches(**every).select(known)


def replace_inliers(hooks: Hooks, view: View, matches: Matches, inliers: Matches) -> Matches:
    """Replace the inliers among matches."""
    if hooks is NO_HOOKS:
        return inliers
    columns = matches.ids, matches.pixels, np.isin(matches.ids, inliers.ids)
    return matches.select(hooks.inliers(_frame(view.frame), *map(read_only, columns)))


def _by_landmark(matches: Matches, n: int) -> dict[str, Array]:
    """Columns of the matches for each of n landmarks; NO_FEATURE or NaN for those without."""
    columns: dict[str, Array] = {}
    for name, values in vars(matches).items():
        missing = {"i": NO_FEATURE, "b": True}.get(values.dtype.kind, np.nan)
        columns[name] = np.full((n, *values.shape[1:]), missing, values.dtype)
        columns[name][matches.rows] = values
    return columns


def _measure(view: View, pixels: Array, slopes: Array) -> tuple[Array, Array]:
    """Measurements (N, 3) at given pixels, and their standard deviations."""
    settings = view.settings.stereo
    found = measure_disparities(view.frame, view.dense, pixels, settings, slopes=slopes)
    s = view.settings.refinement
    pixel_sigma = np.full((len(pixels), 2), s.sigma_px)
    sigma = np.column_stack([pixel_sigma, np.hypot(found.sigma_px, s.sigma_disparity_px)])
    return np.column_stack([pixels, found.values_px]), sigma
