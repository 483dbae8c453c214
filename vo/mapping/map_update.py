"""How a view that shows something new becomes a keyframe, and what follows from that."""

import numpy as np

from vo.contract.arrays import Array
from vo.map.frame import View
from vo.map.state import Journey
from vo.mapping.keyframes import add_keyframe, is_new_view
from vo.mapping.window_adjustment import refine_map
from vo.tracking.appearance import row_offset_px
from vo.tracking.context import Gear
from vo.tracking.doubt import is_unsettled
from vo.tracking.track_local_map import Location


def grow(here: Journey, view: View, found: Location, gear: Gear, counts: dict[str, int]) -> Array:
    """Let a new view grow and refine the map (thesis 3.4, 4.4); the pose (4, 4) afterwards."""
    s, T_odom_cam, inliers = view.settings, found.pose.T_world_cam, found.inliers
    unsettled = is_unsettled(counts["motion iterations"], s)  # (5.3)
    last, few = here.map.keyframes[-1], s.motion.weak_inliers
    if unsettled or not is_new_view(last, inliers, s.refinement, few):
        return T_odom_cam
    spread = here.covariance(T_odom_cam, found.pose.covariance)
    here.map = add_keyframe(here.map, view, T_odom_cam, spread, inliers, gear.rig, s, gear.hooks)
    here.before = here.map.keyframes[-1].sighting
    here.map, counts["structure iterations"] = refine_map(here.map, gear.rig, s)
    here.stitch(view, gear.rig, s, gear.rng)  # to a segment that was lost (6)
    here.history.remember(here.map, s.refinement)
    if not np.isnan(lower_px := row_offset_px(view, inliers.measured, s)):
        here.row_offsets_px.append(lower_px)
    return here.map.keyframes[-1].T_odom_cam
