"""What tracking of a view needs, and what it finds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, find_sorted
from vo.contract.clock import Clock
from vo.contract.observations import Observations
from vo.hooks import Hooks
from vo.map.frame import Matches, View
from vo.map.local_map import Landmarks
from vo.tracking.budget import Budget


@dataclass(frozen=True)
class Context:
    """Hooks on the stages of one frame, random numbers for RANSAC, the clock and the budget."""

    hooks: Hooks
    rng: np.random.Generator
    clock: Clock
    budget: Budget


@dataclass(frozen=True)
class Tracked:
    """Pose (4, 4) of a view, with its covariance (6, 6) given the map and the matches it rests on.

    Attributes:
        by_klt: Whether the matches come from the previous frame, not from templates.
        tried: Number of landmarks that were looked for.
        is_new: Whether the view has moved far enough from the last keyframe to become one.
        counts: Number of items that passed each stage, and iterations.
    """

    view: View
    T_odom_cam: Array
    covariance: Array
    matches: Matches
    inliers: Matches
    by_klt: bool
    tried: int
    is_new: bool
    counts: Mapping[str, int]

    def moved(self, T_new_old: Array, landmarks: Landmarks) -> Self:
        """Move the view with a rigid motion (4, 4) of the map, which may have lost landmarks."""
        return replace(
            self,
            T_odom_cam=se3.orthonormal(T_new_old @ self.T_odom_cam),
            matches=self.matches.renew(landmarks),
            inliers=self.inliers.renew(landmarks),
        )

    def observations(self) -> Observations:
        """All matches as observations."""
        agree = find_sorted(self.inliers.ids, self.matches.ids) >= 0
        return replace(self.matches, inlier=agree).observations

    @property
    def is_reliable(self) -> bool:
        """Whether enough of the landmarks that were looked for are inliers (decision 22)."""
        return len(self.inliers) >= self.view.settings.matching.min_inlier_ratio * self.tried


@dataclass(frozen=True)
class NotTracked:
    """A view without a pose: too few landmarks agree with any; counts as for `Tracked`."""

    counts: Mapping[str, int]
    is_reliable: bool = False
