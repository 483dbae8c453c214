"""Displacement of a blurred image from its label: the mean of an exposure is not its middle.

Labels hold at mid-exposure. Where the camera accelerates during the exposure, as in a jolt or where
a turn begins, the image, a mean over the exposure, is displaced by up to some tenths of a pixel.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.camera.camera import FrameExposure
from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig

SAMPLES = 33
"""Odd number of poses in an exposure, so that one is in its middle."""
FACTOR = 2.0
"""Largest displacement over that in the image's middle: towards its corners, of points nearer than
the median, and from what lies between two states."""


@dataclass(frozen=True)
class CameraMotion:
    """True poses (N, 4, 4) of the left camera in the world at times (N,), N >= 2."""

    times_ns: Indices
    T_world_cam: Array
    rig: StereoRig

    def displacement_px(self, exposure: FrameExposure, disparity_px: Array) -> float:
        """Bound the displacement of an image from its labels; disparities are (H, W)."""
        if exposure.exposure_ms == 0 or len(self.times_ns) < 2:
            return 0.0
        half_ns = exposure.exposure_ms * 5e5
        times_ns = exposure.timestamp_ns + np.linspace(-half_ns, half_ns, SAMPLES)
        times_ns = times_ns.clip(self.times_ns[0], self.times_ns[-1])
        first = max(int(np.searchsorted(self.times_ns, times_ns[0])) - 1, 0)
        last = int(np.searchsorted(self.times_ns, times_ns[-1])) + 1
        T, known_ns = self.T_world_cam[first:last], self.times_ns[first:last]
        if len(known_ns) < 2:
            return 0.0
        poses = Slerp(known_ns, Rotation.from_matrix(T[:, :3, :3]))(times_ns)
        middle = poses[SAMPLES // 2]
        turn_rad = np.linalg.norm((middle.inv() * poses).as_rotvec().mean(axis=0))
        places = np.stack([np.interp(times_ns, known_ns, x) for x in T[:, :3, 3].T], axis=1)
        moved_m = np.linalg.norm(places.mean(axis=0) - places[SAMPLES // 2])
        near = np.nanmedian(disparity_px) if np.isfinite(disparity_px).any() else 0.0
        by_turn_px, by_motion_px = self.rig.f_px * turn_rad, moved_m * near / self.rig.baseline_m
        return FACTOR * float(by_turn_px + by_motion_px)
