"""The truth in the place of a stage, to see what that stage costs.

Only here does truth meet the estimator, through `vo.hooks`, which knows nothing of it. The world
is taken to be at rest: a landmark on something that moves is not matched once it has moved, and is
no inlier.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from trials.truth import TrueWorld
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.errors import SettingsError
from vo.contract.sequence import StereoFrame
from vo.hooks import Hooks

STAGES = {
    "prediction": "where the search for matches starts",
    "matches": "where landmarks appear, and which of them do",
    "stereo": "the disparity of features",
    "inliers": "which matches are right",
}
"""Stages that can be replaced."""

RIGHT_PX = 1.0
"""A match is right if it is this close to where the landmark truly appears."""


class Oracle(Hooks):
    """Answers with the truth for chosen stages, and passes the others on."""

    def __init__(
        self, dataset: Path, stages: Collection[str] = tuple(STAGES), noise_px: float = 0.0,
        seed: int = 0,
    ) -> None:  # fmt: skip
        """Open the labels.

        Args:
            dataset: Folder with depth labels and true poses.
            stages: Keys of STAGES.
            noise_px: Standard deviation of what is added to true pixels (u and v) and disparities.
            seed: Of that noise; it depends on nothing else but the frame.

        Raises:
            SettingsError: If a stage is none of STAGES.
            DatasetError: If the labels are not there.
        """
        unknown = sorted(set(stages) - set(STAGES))
        if unknown:
            raise SettingsError(f"unknown stage {unknown[0]}; valid: {', '.join(STAGES)}")
        self.stages = frozenset(stages)
        self.noise_px, self.seed = noise_px, seed
        self._world = TrueWorld(dataset)
        self._points: dict[int, Array] = {}  # of every landmark, by its identifier

    def born(self, frame: StereoFrame, ids: Indices, pixels: Array) -> None:
        """Remember which points of the world the landmarks are."""
        points = self._world.points_world(frame.timestamp_ns, pixels)
        self._points.update(zip(ids.tolist(), points, strict=True))

    def predicted(
        self, frame: StereoFrame, last_ns: int, T_odom_last: Array, T_odom_cam: Array
    ) -> Array:
        """Continue the last pose by the true motion since."""
        if "prediction" not in self.stages:
            return T_odom_cam
        T_last_world = se3.inverse(self._world.T_world_cam(last_ns))
        return T_odom_last @ T_last_world @ self._world.T_world_cam(frame.timestamp_ns)

    def pixels(self, frame: StereoFrame, ids: Indices, pixels: Array) -> Array:
        """Where each landmark's point is, if it can be seen."""
        if "matches" not in self.stages:
            return pixels
        true = self._world.sightings(frame.timestamp_ns, self._points_of(ids))
        noisy = true + self._noise(frame, 0, true.shape)
        low, high = 0, [self._world.rig.width_px - 1, self._world.rig.height_px - 1]
        return noisy.clip(low, high)

    def disparity(self, frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
        """Disparity of the surface at each pixel."""
        if "stereo" not in self.stages:
            return disparity_px
        true = self._world.disparity(frame.timestamp_ns, pixels)
        return true + self._noise(frame, 1, true.shape)

    def inliers(self, frame: StereoFrame, ids: Indices, pixels: Array, agree: Mask) -> Mask:
        """Those near where their landmark's point truly is."""
        if "inliers" not in self.stages:
            return agree
        off = pixels - self._world.project(frame.timestamp_ns, self._points_of(ids))
        with np.errstate(invalid="ignore"):
            return np.linalg.norm(off, axis=1) < RIGHT_PX

    def _points_of(self, ids: Indices) -> Array:
        unknown = np.full(3, np.nan)
        return np.array([self._points.get(x, unknown) for x in ids.tolist()]).reshape(-1, 3)

    def _noise(self, frame: StereoFrame, stream: int, shape: tuple[int, ...]) -> Array:
        rng = np.random.default_rng((self.seed, frame.timestamp_ns, stream))
        return self.noise_px * rng.standard_normal(shape)
