"""Incremental bundle adjustment of the last keyframes by a fixed-lag smoother.

An alternative to `vo.mapping.window_adjustment` (`refinement.mode` "fixed_lag").
"""

import numpy as np

from vo.bundle_adjustment.adjust import misfit
from vo.bundle_adjustment.fixed_lag import FixedLag
from vo.bundle_adjustment.problem import MIN_POINTS
from vo.config import RefinementSettings
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.map.local_map import LocalMap
from vo.mapping.window_adjustment import learn_noise, move_map, select_landmarks


class IncrementalAdjustment:
    """A smoother and the keyframes in it.

    The smoother starts anew at the last two keyframes where it fails, and where the map is no
    longer the one that it left: after a loss, a map reset or a merge.
    """

    def __init__(self, rig: StereoRig, settings: RefinementSettings) -> None:
        self._rig, self._settings = rig, settings
        self._smoother: FixedLag | None = None
        self._T_odom_cam: dict[int, Array] = {}

    def __call__(self, local_map: LocalMap) -> tuple[LocalMap, int]:
        """Add the newest keyframe; return the adjusted map and the iterations."""
        s = self._settings
        smoother, self._smoother = self._smoother if self._continues(local_map) else None, None
        first = smoother.first if smoother else local_map.keyframes[-2:][0].serial
        keyframes = tuple(k for k in local_map.keyframes if k.serial >= first)
        ids, mask = select_landmarks(local_map, keyframes, s)
        if smoother:
            unspent = ~np.isin(ids, smoother.spent)
            ids, mask = ids[unspent], mask[unspent]
        if len(keyframes) < 2 or mask[:, -1].sum() < MIN_POINTS:
            return local_map, 0
        smoother = smoother or FixedLag(
            first, keyframes[0].T_odom_cam, keyframes[0].covariance, s.window
        )
        points = local_map.landmarks.points_odom[np.searchsorted(local_map.landmarks.ids, ids)]
        poses = {k.serial: k.T_odom_cam for k in keyframes}
        seen = {k.serial: k.observations for k in keyframes}
        try:
            found = smoother.update(poses, seen, ids, points, self._rig, s)
        except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own
            return local_map, s.max_iterations
        unmoved = local_map.keyframes[: -len(keyframes)]
        T = [k.T_odom_cam for k in unmoved] + list(found.T_odom_cam)
        covariance = [k.covariance for k in unmoved] + list(found.covariance)
        moved = move_map(local_map, np.array(T), covariance, found.ids, found.estimates.points)
        self._smoother = smoother
        self._T_odom_cam = {k.serial: k.T_odom_cam for k in moved.keyframes}
        noise = misfit([found.estimates], found.T_odom_cam)
        return learn_noise(moved, noise, s), found.iterations

    def _continues(self, local_map: LocalMap) -> bool:
        """Whether the map's older keyframes are where the smoother left them."""
        older = local_map.keyframes[:-1]
        known = self._T_odom_cam
        return bool(older) and all(
            k.serial in known and np.array_equal(k.T_odom_cam, known[k.serial]) for k in older
        )
