"""Stages of tracking that are off by default, each behind its setting."""

from collections.abc import Mapping

import numpy as np

from vo.contract.arrays import Array
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.map.matches import Matches
from vo.map.state import TrackerState
from vo.tracking.circular_check import is_consistent
from vo.tracking.landmark_prior import sampling_weights, update_outlier_counts


def verify_matches(matches: Matches, state: TrackerState, view: View) -> Matches:
    """Apply the circular check (F4), if `matching.circular_check`."""
    if not view.settings.matching.circular_check or state.previous is None:
        return matches
    return matches.select(is_consistent(matches, state.map.landmarks, state.previous, view))


def weigh_matches(matches: Matches, state: TrackerState, view: View, T_guess: Array) -> Array:
    """Sampling weights (N,): all one, or by the landmark prior, if `motion.landmark_prior`."""
    if not view.settings.motion.landmark_prior:
        return np.ones(len(matches))
    return sampling_weights(matches, state.map, state.outlier_counts, T_guess, view)


def cull_landmarks(
    state: TrackerState, view: View, matches: Matches, inliers: Matches
) -> tuple[LocalMap, Mapping[int, int]]:
    """Remove repeated outliers from the map, if `motion.landmark_prior`; map and outlier counts."""
    if not view.settings.motion.landmark_prior:
        return state.map, state.outlier_counts
    return update_outlier_counts(state.map, state.outlier_counts, matches.ids, inliers.ids)
