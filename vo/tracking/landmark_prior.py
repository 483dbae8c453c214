"""Prior on landmarks by their inlier history and the prediction (`motion.landmark_prior`).

The largest group that moves alike need not be the static scene. Landmarks that have been inliers
for long, and match where they are predicted, are sampled more often than new ones; landmarks that
are outliers again and again are removed.
"""

from dataclasses import replace

import numpy as np

from vo.contract.arrays import Array
from vo.map.frame import Matches, View
from vo.map.state import TrackerState
from vo.pose.estimation import reprojection_errors

MAX_VIEWS = 10
"""Views after which more do not count."""

PREDICTED_WEIGHT = 3.0
"""Weight of a match exactly where it was predicted, to that of one far from there."""

MAX_OUTLIERS = 6
"""Successive frames as an outlier after which a landmark is removed."""


def sampling_weights(matches: Matches, state: TrackerState, view: View, T_guess: Array) -> Array:
    """Weights (N,) of matches in RANSAC, by views, outlier counts and predicted pose (4, 4).

    All one without `motion.landmark_prior`.
    """
    if not view.settings.motion.landmark_prior:
        return np.ones(len(matches))
    views = np.minimum(state.map.landmarks.views[matches.rows], MAX_VIEWS)
    outlier = np.array([state.outlier_counts.get(int(i), 0) for i in matches.ids], dtype=np.int64)
    rays = view.rig.normalized(matches.pixels)
    errors = reprojection_errors(T_guess, matches.points_odom, rays)
    errors = np.nan_to_num(errors / view.settings.motion.threshold, nan=np.inf)
    return views / (1 + outlier) ** 2 * (1 + (PREDICTED_WEIGHT - 1) / (1 + errors**2))


def cull_landmarks(state: TrackerState, view: View, matches: Matches, inliers: Matches) -> None:
    """Count the outliers of a frame; remove landmarks that were outliers too often in succession.

    Nothing happens without `motion.landmark_prior`.
    """
    if not view.settings.motion.landmark_prior:
        return
    outliers = set(np.setdiff1d(matches.ids, inliers.ids, assume_unique=True).tolist())
    absent = state.outlier_counts.keys() - set(matches.ids.tolist())
    counts = {i: state.outlier_counts[i] for i in absent}
    counts |= {i: state.outlier_counts.get(i, 0) + 1 for i in outliers}
    landmarks = state.map.landmarks
    removed = [i for i, count in counts.items() if count >= MAX_OUTLIERS]
    if removed:
        landmarks = landmarks.select(~np.isin(landmarks.ids, removed))
        state.map = replace(state.map, landmarks=landmarks)
    known = set(landmarks.ids.tolist())
    state.outlier_counts = {i: count for i, count in counts.items() if i in known}
