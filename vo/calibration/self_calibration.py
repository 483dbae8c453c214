"""Calibration of the pair while it is used, from the landmarks of keyframes."""

from functools import reduce

import numpy as np

from vo.calibration.stereo_errors import StereoSamples, estimate_errors
from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig
from vo.stereo.right_camera import RightCamera, StereoErrors

ESTIMATED_AT = (2, 8, 32)
"""Numbers of keyframes at which errors are estimated; after the last one, none are gathered."""

MAX_POINTS, MIN_POINTS = 80, 150
"""Points of one keyframe, and of all that are needed."""

MIN_EFFECT_PX = 0.15
"""Motion of the right image by an error from which on errors are corrected: smaller ones cost less
than what their estimates change."""

NEW_MAP_PX = 0.05
"""Change of disparities by changed errors above which landmarks are triangulated anew."""


NO_SAMPLES = StereoSamples(
    np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 6)), np.zeros(0, np.int64)
)


class SelfCalibration:
    """Gathers points that both eyes see, each landmark once, and estimates what is wrong.

    Attributes:
        errors: Those that are significant; None as long as none is.
        time_ns: Time of the points that were added last.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        self._samples: list[StereoSamples] = []
        self._next_id = 0
        self._waiting = np.zeros((0, 2)), np.zeros((0, 2))
        self.time_ns = -1
        self.errors: StereoErrors | None = None

    @property
    def gathers(self) -> bool:
        """Whether samples are still needed."""
        return len(self._samples) < ESTIMATED_AT[-1]

    @property
    def samples(self) -> StereoSamples:
        """All points so far."""
        return reduce(StereoSamples.extend, self._samples, NO_SAMPLES)

    def unused(self, ids: Indices, next_id: int) -> Indices:
        """Rows (K,) of landmarks (N,) that have not been seen; later only those from `next_id` on.

        The texture of one landmark moves its row alike again. Of many, some are taken.
        """
        rows = np.flatnonzero(ids >= self._next_id)
        self._next_id = next_id
        return rows[:: -(-len(rows) // MAX_POINTS) or 1]

    def add(self, time_ns: int, pixels: Array, right_pixels: Array) -> None:
        """Add points at pixels (N, 2) of both images of a keyframe; `complete` has to follow."""
        known = ~np.isnan(right_pixels[:, 0])
        self.time_ns, self._waiting = time_ns, (pixels[known], right_pixels[known])

    def complete(self, velocity: Array | None) -> bool:
        """Take the points that were added last, at a velocity (6,); without one, drop them.

        Returns:
            Whether the errors have changed so much that landmarks are no longer where they were.
        """
        pixels, right_pixels = self._waiting
        n = len(pixels)
        if velocity is None or n == 0:
            return False
        frame = np.full(n, len(self._samples))
        new = StereoSamples(pixels, right_pixels, np.tile(velocity, (n, 1)), frame)
        self._samples.append(new)
        if len(self._samples) not in ESTIMATED_AT:
            return False
        samples = self.samples
        if len(samples) < MIN_POINTS:
            return False
        if self.errors is None:
            large = estimate_errors(samples, self._rig, MIN_EFFECT_PX).corrected
            if large == StereoErrors():
                return False
        found = estimate_errors(samples, self._rig).corrected
        before, self.errors = self.errors or StereoErrors(), found
        return _change_px(samples, self._rig, before, found) > NEW_MAP_PX


def _change_px(
    samples: StereoSamples, rig: StereoRig, before: StereoErrors, now: StereoErrors
) -> float:
    """Root mean square of the change of disparities by a change of errors, px."""
    cameras = (RightCamera(x, rig, samples.velocity) for x in (before, now))
    columns = samples.right_pixels[:, 0]
    change_px = np.subtract(*(x.disparity(samples.pixels, columns) for x in cameras))
    return float(np.sqrt(np.mean(change_px**2)))
