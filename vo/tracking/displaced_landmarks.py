"""Landmarks found by their displacement from the previous frame, without features."""

import numpy as np

from vo.contract.arrays import Array, find_sorted
from vo.map.frame import Matches, View
from vo.map.local_map import LocalMap, TrackedFrame
from vo.patches.displacement_search import halve, search_displacements
from vo.tracking.association import in_view, project_landmarks, spread

NEAR_PX = 8.0
"""Radius of the first search: predictions of a steady motion are better than that."""

SIGMA_PX = 0.7
"""Standard deviation of u and v in halved images, in pixels of whole ones."""


def find_displaced(
    local_map: LocalMap, previous: TrackedFrame, view: View, T_odom_cam: Array, radius_px: float
) -> Matches:
    """Match landmarks that the previous frame observed, near their projections by a pose (4, 4).

    At most `matching.probes`, from every part of the image; to within a pixel, without disparity.
    """
    seen, landmarks, s = previous.observations, local_map.landmarks, view.settings.matching
    expected = project_landmarks(landmarks, T_odom_cam, view)
    place = find_sorted(seen.ids, landmarks.ids)
    known = place >= 0
    rows = np.flatnonzero(known & in_view(expected, view))
    rows = spread(rows, expected, known, s.probes, view.settings)
    pixels = seen.pixels[place[rows]]
    before, now = halve(previous.left), halve(view.frame.left)
    found, zncc = search_displacements(before, now, pixels, expected[rows, :2], radius_px)
    good = zncc > s.min_zncc  # not NaN
    n = int(good.sum())
    sigma_px = np.tile([SIGMA_PX, SIGMA_PX, np.nan], (n, 1))
    none = np.full(n, np.nan)
    return Matches.of(landmarks, rows[good], found[good], none, sigma_px, zncc=zncc[good])
