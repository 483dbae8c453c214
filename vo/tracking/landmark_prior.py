"""Prior on landmarks by their inlier history and the prediction (`motion.landmark_prior`).

The largest group that moves alike need not be the static scene. Landmarks that have been inliers
for long, and match where they are predicted, are sampled more often than new ones; landmarks that
are outliers again and again are removed.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.map.matches import Matches
from vo.pose.estimation import reprojection_errors

MAX_VIEWS = 10
"""Views after which more do not count."""

PREDICTED_WEIGHT = 3.0
"""Weight of a match exactly where it was predicted, to that of one far from there."""

MAX_OUTLIERS = 6
"""Successive frames as an outlier after which a landmark is removed."""


def sampling_weights(
    matches: Matches,
    local_map: LocalMap,
    outlier_counts: Mapping[int, int],
    T_odom_guess: Array,
    view: View,
) -> Array:
    """Weights (N,) of matches in RANSAC, by views, outlier counts and predicted pose (4, 4)."""
    views = np.minimum(local_map.landmarks.views[matches.rows], MAX_VIEWS)
    outlier = np.array([outlier_counts.get(int(i), 0) for i in matches.ids], dtype=np.int64)
    rays = view.rig.normalized(matches.pixels)
    errors = reprojection_errors(T_odom_guess, matches.points_odom, rays)
    errors = np.nan_to_num(errors / view.settings.motion.threshold, nan=np.inf)
    return views / (1 + outlier) ** 2 * (1 + (PREDICTED_WEIGHT - 1) / (1 + errors**2))


def update_outlier_counts(
    local_map: LocalMap, outlier_counts: Mapping[int, int], matched: Indices, inliers: Indices
) -> tuple[LocalMap, dict[int, int]]:
    """Count the outliers of a frame; remove landmarks that were outliers too often in succession.

    Args:
        local_map: Of the landmarks.
        outlier_counts: Landmark to its number of successive frames as an outlier.
        matched: (N,) landmarks.
        inliers: Those of them that are inliers.
    """
    outliers = set(np.setdiff1d(matched, inliers, assume_unique=True).tolist())
    absent = outlier_counts.keys() - set(matched.tolist())
    counts = {i: outlier_counts[i] for i in absent}
    counts |= {i: outlier_counts.get(i, 0) + 1 for i in outliers}
    removed = [i for i, count in counts.items() if count >= MAX_OUTLIERS]
    if removed:
        keep = ~np.isin(local_map.landmarks.ids, removed)
        local_map = replace(local_map, landmarks=local_map.landmarks.select(keep))
    known = set(local_map.landmarks.ids.tolist())
    return local_map, {i: count for i, count in counts.items() if i in known}
