"""Matches between the landmarks of the map and a view."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.observations import Observations
from vo.map.local_map import LocalMap

NO_FEATURE = -1
"""Row of the feature of a match that was found without one."""


@dataclass(frozen=True, kw_only=True)
class Matches(Observations):
    """Observations of landmarks of the map in a view, row by row.

    Attributes:
        rows: (N,) rows of the map's landmarks, each once.
        points_odom: (N, 3) positions of the landmarks, metres.
        features: (N,) rows of the view's features, NO_FEATURE where there is none.
        zncc: (N,) correlation with the landmark's template; NaN if unknown.
    """

    rows: Indices
    points_odom: Array
    features: Indices
    zncc: Array

    @property
    def observations(self) -> Observations:
        """The observations without what concerns the map."""
        return Observations(self.ids, self.pixels, self.disparity_px, self.inlier, self.sigma_px)

    def merge(self, other: Self) -> Self:
        """Add matches of other landmarks, sorted by landmark."""
        both = self.extend(other)
        return both.select(np.argsort(both.rows))


def newest_matches(local_map: LocalMap) -> Matches:
    """Matches of a map's first keyframe with its own landmarks."""
    seen, n = local_map.keyframes[-1].observations, len(local_map.landmarks)
    return Matches(
        ids=seen.ids,
        pixels=seen.pixels,
        disparity_px=seen.disparity_px,
        sigma_px=seen.sigma_px,
        rows=np.arange(n),
        points_odom=local_map.landmarks.points_odom,
        features=np.full(n, NO_FEATURE),
        zncc=np.full(n, np.nan),
    )
