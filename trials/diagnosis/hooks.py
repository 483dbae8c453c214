"""Hooks into the estimator: ground truth in place of its output, and known errors added to it.

Ground truth reaches the estimator only here, through the general interface `vo.hooks`. The world is
assumed static: a landmark on a moving object is neither matched nor an inlier once it has moved.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trials.evaluation.truth import TrueWorld
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks

ORACLES = {
    "prediction": "start of the search for matches",
    "matches": "which landmarks are matched, and to which surface point",
    "features": "image positions of correct matches",
    "stereo": "disparities of features",
    "inliers": "which matches are inliers",
}
"""Outputs that can be replaced, with a description. A landmark is defined as the surface point at
its first pixel, which therefore has no error; `features` are its later positions."""

MAX_INLIER_PX = 1.0
"""Largest distance of a true inlier from the projection of its landmark, pixels."""

MAX_MATCH_PX = 3.0
"""Largest distance of a correct match from the projection of its landmark, pixels: the range of
the alignment of patches."""

PIXELS, DISPARITIES, MATCH_ERRORS = range(3)
"""Random streams."""


class Oracle(Hooks):
    """Hooks that return the truth for chosen outputs and pass on the others.

    Attributes:
        chosen: Keys of ORACLES that are replaced.
        queried: Keys for which the estimator has called its hooks so far, replaced or not.
        births: Landmark to the time, ns, and the (u, v) at which it was first observed.

    Example:
        >>> oracle = dy.Oracle(ds.path, ["matches", "stereo"], noise_px=0.1)
        >>> odometry = dy.StereoOdometry(ds.rig, hooks=oracle)
        >>> [odometry.track(frame).status.value for frame in (ds[0], ds[1])]
        ['start', 'tracked']
    """

    def __init__(
        self, dataset: Path, chosen: Collection[str] = tuple(ORACLES), noise_px: float = 0.0,
        seed: int = 0, rig: StereoRig | None = None,
    ) -> None:  # fmt: skip
        """Open the labels of depth and the true poses of a dataset.

        Noise of std. dev. `noise_px`, which depends on seed and frame only, is added to true pixels
        (u and v) and disparities, px. The latter are those that give the true depth with the
        calibration `rig` that the estimator uses; None for the true one.

        Raises:
            SettingsError: If a key is not in ORACLES.
            DatasetError: If there are no labels.
        """
        unknown = sorted(set(chosen) - set(ORACLES))
        if unknown:
            raise SettingsError(f"unknown stage {unknown[0]}; valid: {', '.join(ORACLES)}")
        self.chosen = frozenset(chosen)
        self.queried: set[str] = set()
        self.noise_px, self.seed = noise_px, seed
        self._world = TrueWorld(dataset)
        true = self._world.rig
        assumed = rig or true
        self._disparity_scale = assumed.f_px * assumed.baseline_m / true.f_px / true.baseline_m
        self.births: dict[int, tuple[int, float, float]] = {}
        self._points: dict[int, Array] = {}  # landmark to world position

    def new_landmarks(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Record the surface points of new landmarks."""
        points = self._world.points_world(frame.timestamp_ns, pixels)
        self._points.update(zip(ids.tolist(), points, strict=True))
        for x, (u, v) in zip(ids.tolist(), pixels.tolist(), strict=True):
            self.births[x] = frame.timestamp_ns, u, v

    def predicted_pose(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Compose the last estimated pose with the true motion since."""
        self.queried.add("prediction")
        if "prediction" not in self.chosen:
            return T_odom_cam
        T_last_world = se3.inverse(self._world.T_world_cam(last_ns))
        return T_odom_last @ T_last_world @ self._world.T_world_cam(frame.timestamp_ns)

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Return the image position of each landmark.

        With `matches`, every visible landmark is matched; where the estimator matched it wrongly or
        not at all, its error is drawn from those of the correct matches of this frame. With
        `features`, correct matches are moved to the exact projection.
        """
        self.queried.update(("matches", "features"))
        if not self.chosen & {"matches", "features"}:
            return pixels
        time, points = frame.timestamp_ns, self._points_of(ids)
        true = self._world.project(time, points)
        near = _near(pixels, true, MAX_MATCH_PX)
        matched = pixels
        if "matches" in self.chosen:
            true = self._world.project_visible(time, points)
            near &= ~np.isnan(true[:, 0])
            matched = np.where(
                near[:, None], pixels, true + self._drawn_errors(frame, pixels, true)
            )
        if "features" in self.chosen:
            exact = near | ("matches" in self.chosen)
            noisy = true + self._noise(frame, PIXELS, true.shape)
            matched = np.where(exact[:, None], noisy, matched)
        low, high = 0, [self._world.rig.width_px - 1, self._world.rig.height_px - 1]
        return matched.clip(low, high)

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Return the disparity of the surface at each pixel."""
        self.queried.add("stereo")
        if "stereo" not in self.chosen:
            return disparity_px
        true = self._disparity_scale * self._world.disparity(frame.timestamp_ns, pixels)
        return true + self._noise(frame, DISPARITIES, true.shape)

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Return the matches close to the projection of their landmark."""
        self.queried.add("inliers")
        if "inliers" not in self.chosen:
            return agree
        return _near(
            pixels, self._world.project(frame.timestamp_ns, self._points_of(ids)), MAX_INLIER_PX
        )

    def _points_of(self, ids: Indices) -> Array:
        unknown = np.full(3, np.nan)
        return np.array([self._points.get(x, unknown) for x in ids.tolist()]).reshape(-1, 3)

    def _drawn_errors(self, frame: StereoFrame, pixels: Array, true: Array) -> Array:
        """Draw errors (L, 2) from those of the correct matches."""
        errors = (pixels - true)[_near(pixels, true, MAX_MATCH_PX)]
        if len(errors) == 0:
            return np.zeros_like(true)
        return self._rng(frame, MATCH_ERRORS).choice(errors, len(true))

    def _noise(self, frame: StereoFrame, stream: int, shape: tuple[int, ...]) -> Array:
        return self.noise_px * self._rng(frame, stream).standard_normal(shape)

    def _rng(self, frame: StereoFrame, stream: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, frame.timestamp_ns, stream))


def _near(pixels: Array, true: Array, max_px: float) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(pixels - true, axis=1) < max_px


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
