"""Injection of known errors into one stage, to validate the attribution."""

from dataclasses import dataclass, replace

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks


@dataclass(frozen=True)
class InjectedError:
    """Error that is injected; zero by default.

    Attributes:
        pixel_sigma_px: Std. dev. of noise added to u and v of every match, drawn for every frame.
        disparity_bias_px: Bias added to every disparity.
        baseline_percent: Relative error of the baseline that the estimator uses, %.
    """

    pixel_sigma_px: float = 0.0
    disparity_bias_px: float = 0.0
    baseline_percent: float = 0.0

    def rig(self, rig: StereoRig) -> StereoRig:
        """Return the wrong calibration for a true one."""
        return replace(rig, baseline_m=rig.baseline_m * (1 + self.baseline_percent / 100))


class ErrorInjector(Hooks):
    """Hooks that add errors to the estimator's output before other hooks receive it.

    An estimator may pass a value to its hooks again in the same frame; no error is added to a value
    that was returned in this frame.
    """

    def __init__(self, error: InjectedError, inner: Hooks, seed: int = 0) -> None:
        self.error, self.inner, self.seed = error, inner, seed
        self._time_ns = -1
        self._returned_pixels: dict[int, tuple[float, ...]] = {}  # by landmark
        self._returned_disparity: dict[tuple[float, ...], float] = {}  # by pixel
        # Passed on without an error:
        self.features, self.new_landmarks = inner.features, inner.new_landmarks
        self.predicted_pose, self.inliers = inner.predicted_pose, inner.inliers

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Add noise."""
        self._begin(frame)
        returned = [self._returned_pixels.get(x) for x in ids.tolist()]
        fresh = np.array([t != tuple(p) for t, p in zip(returned, pixels.tolist(), strict=True)])
        rng = np.random.default_rng((self.seed, frame.timestamp_ns))
        noise = self.error.pixel_sigma_px * rng.standard_normal(pixels.shape)
        answer = self.inner.pixels(frame, ids, pixels + noise * fresh[:, None])
        self._returned_pixels.update(zip(ids.tolist(), map(tuple, answer.tolist()), strict=True))
        return answer

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Add the bias."""
        self._begin(frame)
        keys = list(map(tuple, pixels.tolist()))
        returned = np.array([self._returned_disparity.get(key, np.nan) for key in keys])
        bias = np.where(returned == disparity_px, 0.0, self.error.disparity_bias_px)
        answer = self.inner.disparity(frame, pixels, disparity_px + bias)
        self._returned_disparity.update(zip(keys, answer.tolist(), strict=True))
        return answer

    def _begin(self, frame: StereoFrame) -> None:
        if frame.timestamp_ns != self._time_ns:
            self._time_ns = frame.timestamp_ns
            self._returned_pixels.clear()
            self._returned_disparity.clear()
