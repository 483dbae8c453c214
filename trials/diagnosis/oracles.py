"""The truth in the place of a stage, to see what that stage costs.

Only here does truth meet the estimator, through `vo.hooks`, which knows nothing of it. The world
is taken to be at rest: a landmark on something that moves is not matched once it has moved, and is
no inlier.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from trials.evaluation.truth import TrueWorld
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks

STAGES = {
    "prediction": "where the search for matches starts",
    "matches": "which landmarks are found, and on what",
    "features": "where exactly in the image, for those found on the right thing",
    "stereo": "the depth of features",
    "inliers": "which matches are taken to be right",
}
"""Stages that can be replaced. A landmark is the surface point at its first pixel, so that pixel
has no error; `features` are its later ones."""

RIGHT_PX = 1.0
"""An inlier is this close to where the landmark truly appears."""

NEAR_PX = 3.0
"""A match this close is on the right thing, only badly placed: as far as alignment reaches."""

PIXELS, DISPARITIES, PLACES = range(3)
"""Streams of noise."""


class Oracle(Hooks):
    """Answers with the truth for chosen stages, and passes the others on.

    Attributes:
        stages: Those chosen.
        asked: Those that the estimator has asked for so far, chosen or not.
        births: Landmark to the time and the (u, v) of the surface point that it is.
    """

    def __init__(
        self, dataset: Path, stages: Collection[str] = tuple(STAGES), noise_px: float = 0.0,
        seed: int = 0, rig: StereoRig | None = None,
    ) -> None:  # fmt: skip
        """Open the labels.

        Args:
            dataset: Folder with depth labels and true poses.
            stages: Keys of STAGES.
            noise_px: Standard deviation of what is added to true pixels (u and v) and disparities.
            seed: Of all that is drawn; it depends on nothing else but the frame.
            rig: What the estimator takes the camera for: true disparities are those that mean the
                true depth to it. The camera as it is if None.

        Raises:
            SettingsError: If a stage is none of STAGES.
            DatasetError: If the labels are not there.
        """
        unknown = sorted(set(stages) - set(STAGES))
        if unknown:
            raise SettingsError(f"unknown stage {unknown[0]}; valid: {', '.join(STAGES)}")
        self.stages = frozenset(stages)
        self.asked: set[str] = set()
        self.noise_px, self.seed = noise_px, seed
        self._world = TrueWorld(dataset)
        true = self._world.rig
        believed = rig or true
        self._disparity_scale = believed.f_px * believed.baseline_m / true.f_px / true.baseline_m
        self.births: dict[int, tuple[int, float, float]] = {}
        self._points: dict[int, Array] = {}  # of every landmark, by its identifier

    def born(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Remember which points of the world the landmarks are."""
        points = self._world.points_world(frame.timestamp_ns, pixels)
        self._points.update(zip(ids.tolist(), points, strict=True))
        for x, (u, v) in zip(ids.tolist(), pixels.tolist(), strict=True):
            self.births[x] = frame.timestamp_ns, u, v

    def predicted(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Continue the last pose by the true motion since."""
        self.asked.add("prediction")
        if "prediction" not in self.stages:
            return T_odom_cam
        T_last_world = se3.inverse(self._world.T_world_cam(last_ns))
        return T_odom_last @ T_last_world @ self._world.T_world_cam(frame.timestamp_ns)

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Where each landmark's point is.

        With `matches`, every landmark that can be seen is found; where the estimator found it on
        the wrong thing or not at all, it is put as far off the truth as a match of this frame that
        is on the right thing. With `features`, those on the right thing are put exactly there.
        """
        self.asked.update(("matches", "features"))
        if not self.stages & {"matches", "features"}:
            return pixels
        time, points = frame.timestamp_ns, self._points_of(ids)
        true = self._world.project(time, points)
        near = _near(pixels, true, NEAR_PX)
        places = pixels
        if "matches" in self.stages:
            true = self._world.sightings(time, points)
            near &= ~np.isnan(true[:, 0])
            places = np.where(near[:, None], pixels, true + self._drawn_errors(frame, pixels, true))
        if "features" in self.stages:
            exact = near | ("matches" in self.stages)
            noisy = true + self._noise(frame, PIXELS, true.shape)
            places = np.where(exact[:, None], noisy, places)
        low, high = 0, [self._world.rig.width_px - 1, self._world.rig.height_px - 1]
        return places.clip(low, high)

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Disparity of the surface at each pixel."""
        self.asked.add("stereo")
        if "stereo" not in self.stages:
            return disparity_px
        true = self._disparity_scale * self._world.disparity(frame.timestamp_ns, pixels)
        return true + self._noise(frame, DISPARITIES, true.shape)

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Those near where their landmark's point truly is."""
        self.asked.add("inliers")
        if "inliers" not in self.stages:
            return agree
        return _near(
            pixels, self._world.project(frame.timestamp_ns, self._points_of(ids)), RIGHT_PX
        )

    def _points_of(self, ids: Indices) -> Array:
        unknown = np.full(3, np.nan)
        return np.array([self._points.get(x, unknown) for x in ids.tolist()]).reshape(-1, 3)

    def _drawn_errors(self, frame: StereoFrame, pixels: Array, true: Array) -> Array:
        """Errors (L, 2) drawn from those of the matches that are on the right thing."""
        errors = (pixels - true)[_near(pixels, true, NEAR_PX)]
        if len(errors) == 0:
            return np.zeros_like(true)
        return self._rng(frame, PLACES).choice(errors, len(true))

    def _noise(self, frame: StereoFrame, stream: int, shape: tuple[int, ...]) -> Array:
        return self.noise_px * self._rng(frame, stream).standard_normal(shape)

    def _rng(self, frame: StereoFrame, stream: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, frame.timestamp_ns, stream))


def _near(pixels: Array, true: Array, reach_px: float) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(pixels - true, axis=1) < reach_px
