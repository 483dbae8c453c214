"""How far a landmark is believed to be at rest, by its record and by the expected motion.

The largest group that moves alike need not be the world. What has agreed with the camera's motion
for long, and agrees with the motion that is expected, weighs more than what appeared just now.
"""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig
from vo.map.local_map import LocalMap
from vo.pose.estimation import reprojection_errors
from vo.tracking.association import Matches

PROVEN = 10
"""Views after which more do not count."""

EXPECTED = 3.0
"""So many times more does a match weigh that is just where it was expected."""

DROPPED = 6
"""Frames in a row in which a landmark disagreed, after which it is forgotten."""


def believed(
    matches: Matches,
    local_map: LocalMap,
    strikes: dict[int, int],
    T_odom_guess: Array,
    rig: StereoRig,
    settings: OdometrySettings,
) -> Array:
    """Weights (N,) of matches under RANSAC; all one without `motion.landmark_prior`.

    Args:
        matches: With landmarks of the map.
        local_map: Knows how many frames agreed with each.
        strikes: Landmark to frames in a row that it disagreed with.
        T_odom_guess: (4, 4) expected pose.
        rig: Projects.
        settings: Whether, and the threshold of an inlier.
    """
    if not settings.motion.landmark_prior:
        return np.ones(len(matches))
    views = np.minimum(local_map.landmarks.views[matches.rows], PROVEN)
    disagreed = np.array([strikes.get(int(i), 0) for i in matches.ids], dtype=np.int64)
    rays = rig.normalized(matches.pixels)
    errors = reprojection_errors(T_odom_guess, matches.points_odom, rays)
    errors = np.nan_to_num(errors / settings.motion.threshold, nan=np.inf)
    return views / (1 + disagreed) ** 2 * (1 + (EXPECTED - 1) / (1 + errors**2))


def judge(
    local_map: LocalMap, strikes: dict[int, int], matched: Indices, agreed: Indices
) -> tuple[LocalMap, dict[int, int]]:
    """Count who disagrees with a frame's motion, and forget who does so again and again.

    Args:
        local_map: Of the landmarks.
        strikes: Landmark to frames in a row that it disagreed with, before this one.
        matched: (N,) landmarks found in the frame.
        agreed: Those of them that agree with its motion.
    """
    against = set(np.setdiff1d(matched, agreed, assume_unique=True).tolist())
    absent = strikes.keys() - set(matched.tolist())
    strikes = {i: strikes[i] for i in absent} | {i: strikes.get(i, 0) + 1 for i in against}
    gone = [i for i, count in strikes.items() if count >= DROPPED]
    if gone:
        keep = ~np.isin(local_map.landmarks.ids, gone)
        local_map = replace(local_map, landmarks=local_map.landmarks.select(keep))
    known = set(local_map.landmarks.ids.tolist())
    return local_map, {i: count for i, count in strikes.items() if i in known}
