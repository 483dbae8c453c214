"""Motion blur of a view: how far the image moves during the exposure, by what looks most alike.

The direction is that of the motion from frame to frame; its share during the exposure, which no
recording needs to state, is the one by which blurred templates are most like the image.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from vo.contract.arrays import Array, find_sorted
from vo.map.frame import View
from vo.map.local_map import LocalMap, TrackedFrame
from vo.tracking.association import in_view, project_landmarks, spread
from vo.tracking.landmark_alignment import align_landmarks

MIN_FLOW_PX = 3.0
"""Motion from frame to frame below which no blur is looked for."""

SHARES = np.linspace(0, 1, 6)
"""Exposures that are tried, over the time between two frames."""

KEYFRAMES = 3
"""Keyframes whose templates are compared."""

PROBES = 60
"""Landmarks that tell which one is right."""


def estimate_smear(
    local_map: LocalMap, previous: TrackedFrame, view: View, T_odom_cam: Array
) -> View:
    """Set the path of a smeared view's pixels, by a rough pose (4, 4), or none beside smeared ones.

    Without a smeared image among the view and the keyframes, nothing is set.
    """
    if not view.is_smeared and all(k.path_px is None for k in local_map.keyframes):
        return view
    still = replace(view, path_px=np.zeros(2))
    if not view.is_smeared:
        return still
    seen, landmarks = previous.observations, local_map.landmarks
    expected = project_landmarks(landmarks, T_odom_cam, view)
    place = find_sorted(seen.ids, landmarks.ids)
    rows = np.flatnonzero((place >= 0) & in_view(expected, view))
    # Of few keyframes, the newest: each trial blurs their images.
    newest = np.unique(landmarks.anchor[rows])[-KEYFRAMES:]
    rows = rows[np.isin(landmarks.anchor[rows], newest)]
    rows = spread(rows, expected, place >= 0, PROBES, view.settings)
    if len(rows) < view.settings.motion.min_inliers:
        return still
    flow_px = np.median(expected[rows, :2] - seen.pixels[place[rows]], axis=0)
    if np.hypot(*flow_px) < MIN_FLOW_PX:
        return still

    @cache
    def likeness(k: int) -> float:
        trial = replace(view, path_px=SHARES[k] * flow_px)
        zncc = align_landmarks(local_map, trial, T_odom_cam, rows, expected[rows, :2]).zncc
        return float(np.nan_to_num(zncc).mean())

    return replace(view, path_px=SHARES[_climb(likeness)] * flow_px)


def _climb(likeness: Callable[[int], float]) -> int:
    """Climb to the best of SHARES from the middle: too little and too much blur are both worse."""
    k = len(SHARES) // 2
    step = 1 if likeness(k) > likeness(k - 1) else -1
    k = k if step > 0 else k - 1
    while 0 <= k + step < len(SHARES) and likeness(k + step) > likeness(k):
        k += step
    return k
