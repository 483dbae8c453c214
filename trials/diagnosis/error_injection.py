"""Errors of known size, put into one stage: what a diagnosis must find again."""

from dataclasses import dataclass, replace

import numpy as np

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks


@dataclass(frozen=True)
class Injection:
    """What is done wrong.

    Attributes:
        pixel_sigma_px: Standard deviation added to u and v of every match, fresh in every frame.
        disparity_bias_px: Added to every disparity.
        baseline_percent: By how much too long the estimator believes the baseline to be.
    """

    pixel_sigma_px: float = 0.0
    disparity_bias_px: float = 0.0
    baseline_percent: float = 0.0

    def rig(self, rig: StereoRig) -> StereoRig:
        """Calibration that the estimator gets in the place of the right one."""
        return replace(rig, baseline_m=rig.baseline_m * (1 + self.baseline_percent / 100))


class Injected(Hooks):
    """Adds errors to what the estimator found, then asks others.

    An estimator may hand out again in the same frame what it was told before; nothing is added to
    that a second time.
    """

    def __init__(self, injection: Injection, then: Hooks, seed: int = 0) -> None:
        self.injection, self.then, self.seed = injection, then, seed
        self._time_ns = -1
        self._told_pixels: dict[int, tuple[float, ...]] = {}  # by landmark
        self._told_disparity: dict[tuple[float, ...], float] = {}  # by pixel

    def features(self, frame: StereoFrame, pixels: Array) -> Array:
        """Pass on."""
        return self.then.features(frame, pixels)

    def born(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Pass on."""
        self.then.born(frame, ids, pixels)

    def predicted(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Pass on."""
        return self.then.predicted(frame, last_ns, T_odom_last, T_odom_cam)

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Add noise."""
        self._begin(frame)
        told = [self._told_pixels.get(x) for x in ids.tolist()]
        fresh = np.array([t != tuple(p) for t, p in zip(told, pixels.tolist(), strict=True)])
        rng = np.random.default_rng((self.seed, frame.timestamp_ns))
        noise = self.injection.pixel_sigma_px * rng.standard_normal(pixels.shape)
        answer = self.then.pixels(frame, ids, pixels + noise * fresh[:, None])
        self._told_pixels.update(zip(ids.tolist(), map(tuple, answer.tolist()), strict=True))
        return answer

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Add the bias."""
        self._begin(frame)
        keys = list(map(tuple, pixels.tolist()))
        told = np.array([self._told_disparity.get(key, np.nan) for key in keys])
        bias = np.where(told == disparity_px, 0.0, self.injection.disparity_bias_px)
        answer = self.then.disparity(frame, pixels, disparity_px + bias)
        self._told_disparity.update(zip(keys, answer.tolist(), strict=True))
        return answer

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Pass on."""
        return self.then.inliers(frame, ids, pixels, agree)

    def _begin(self, frame: StereoFrame) -> None:
        if frame.timestamp_ns != self._time_ns:
            self._time_ns = frame.timestamp_ns
            self._told_pixels.clear()
            self._told_disparity.clear()
