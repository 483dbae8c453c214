"""When a view is so new that it becomes a keyframe (thesis 3.4)."""

import math

import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Indices, find_sorted
from vo.contract.compilation import compiled
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.map.state import TrackerState

MIN_FLOW_PX = 1.0
"""Median flow since the last keyframe below which the camera counts as not moved: however few
landmarks are left, another keyframe would only add its own error (thesis 5.1.3)."""

URGENT = 2.0
"""Factor on the flow that makes a keyframe while the last one waits for its landmarks or for its
adjustment, or had it in this frame: a frame takes the work of one, and some take none, unless the
view changes too fast."""

FAR_BASELINES = 2.0
"""Way from a keyframe, in baselines, from which the next one does not wait for it: further on,
landmarks are known better by the motion of the camera than by one pair of images."""


def must_wait(state: TrackerState, T_odom_cam: Array, rig: StereoRig) -> bool:
    """Whether a keyframe at a pose (4, 4) would wait for the last one."""
    if state.pending is None:
        return False
    way = T_odom_cam[:3, 3] - state.pending.T_odom_cam[:3, 3]
    return math.hypot(*way.tolist()) < FAR_BASELINES * rig.baseline_m


def is_new_view(
    seen: Observations, inliers: Observations, settings: OdometrySettings, share: float = 1.0,
    waits: bool = False,
) -> bool:  # fmt: skip
    """Whether a view has moved far enough from the last keyframe to become one itself.

    The information of a landmark on the translation grows with the disparity, as its image motion
    does: the near ones, which soon leave the image, have most (decision 19), those without
    disparity none. Where hardly any of it, or few inliers, are left, `MIN_FLOW_PX` suffices.

    The keyframe's observations come first. The inliers are those of a share of the information:
    of the landmarks in view, not all may have been looked for. The last keyframe may wait.
    """
    s = settings.refinement
    place = find_sorted(inliers.ids, seen.ids)
    then, now = np.flatnonzero(place >= 0), place[place >= 0]
    if len(then) == 0:
        return True
    flow_px = np.median(np.linalg.norm(inliers.pixels[now] - seen.pixels[then], axis=1))
    weak = len(inliers) < settings.motion.weak_inliers
    if waits:
        return bool(flow_px > (MIN_FLOW_PX if weak else URGENT * s.keyframe_parallax_px))
    left = information_of(seen, inliers.ids)
    few = weak or left < share * s.keyframe_tracked_ratio * information_of(seen, seen.ids)
    return bool(flow_px > (MIN_FLOW_PX if few else s.keyframe_parallax_px))


def information_of(seen: Observations, ids: Indices) -> float:
    """Information on the translation, up to a factor, of observations of some landmarks (N,)."""
    return _sum_squares(seen.ids, seen.disparity_px, ids)


@compiled()
def _sum_squares(ids: Indices, values: Array, wanted: Indices) -> float:
    """Sum the squares of the values (N,), or NaN, of wanted ids (M,); both ascending."""
    total, row = 0.0, 0
    for i in range(len(wanted)):
        while row < len(ids) and ids[row] < wanted[i]:
            row += 1
        if row < len(ids) and ids[row] == wanted[i] and values[row] == values[row]:
            total += values[row] * values[row]
    return total
