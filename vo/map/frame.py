"""A stereo frame with its features and depth, and its matches with the landmarks of the map."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Indices, find_sorted
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.map.local_map import Landmarks, LocalMap

NO_FEATURE = -1
"""Row of the feature of a match that was found without one."""


class Detection:
    """Features of an image, detected when they are first needed: most frames do without.

    Args:
        detect: Function that returns the features (N, 2), sub-pixel (u, v), strongest first, and
            their (N, P) descriptors.
    """

    def __init__(self, detect: Callable[[], tuple[Array, Array]]) -> None:
        self._detect = detect

    @cached_property
    def found(self) -> tuple[Array, Array]:
        """Features (N, 2) and descriptors (N, P)."""
        return self._detect()

    @property
    def counts(self) -> dict[str, int]:
        """Number of features by name; empty as long as none were needed."""
        return {"features": len(self.found[0])} if "found" in vars(self) else {}


@dataclass(frozen=True)
class View:
    """A frame with its features, before its pose is known.

    Attributes:
        detection: Features in the left image.
        dense: Disparity map, px, NaN where unknown; of size zero where stereo is sparse.
        settings: Adapted to the image, for all later stages.
        smoothing_px: Standard deviation of the Gaussian that the images were smoothed by; 0: none.
        is_band_passed: Whether the images are band-passes of those that were taken out of focus.
        is_faint: Whether the texture of the left image, as it was taken, is mostly rounding.
        very_low_snr: Whether texture is buried in noise, and the settings are adapted to that.
        velocity: (6,) of the left camera, tangent (v m/s, w rad/s) in its frame, by which rows of
            a rolling shutter are carried to one instant; None with a global shutter.
        is_smeared: Whether the image looks blurred by motion.
        path_px: (2,) motion of the image during the exposure, px along u, v; None if it is not
            known that there is any, here or in a keyframe.
        blurred: Images of a keyframe and of this view, blurred alike, by the keyframe's serial and
            the path of this one: every search of a frame needs them.
    """

    frame: StereoFrame
    rig: StereoRig
    detection: Detection
    dense: Array
    settings: OdometrySettings
    smoothing_px: float = 0.0
    is_band_passed: bool = False
    is_faint: bool = False
    very_low_snr: bool = False
    velocity: Array | None = None
    is_smeared: bool = False
    path_px: Array | None = None
    blurred: dict[tuple[int, float, float], tuple[Array, Array]] = field(
        default_factory=dict[tuple[int, float, float], tuple[Array, Array]]
    )

    @property
    def features(self) -> Array:
        """Sub-pixel (u, v) in the left image, (N, 2), strongest first."""
        return self.detection.found[0]

    @property
    def descriptors(self) -> Array:
        """Descriptors (N, P) of the features."""
        return self.detection.found[1]


@dataclass(frozen=True, kw_only=True)
class Matches(Observations):
    """Observations of landmarks of the map in a view, row by row.

    Attributes:
        rows: (N,) rows of the map's landmarks, each once.
        points_odom: (N, 3) their positions, metres.
        features: (N,) rows of the view's features, NO_FEATURE where there is none.
        zncc: (N,) correlation with the landmark's template; NaN if unknown.
        spread_odom: (N, 3) standard deviation of the positions along a vector, metres; by default
            zero, exact.
    """

    rows: Indices
    points_odom: Array
    features: Indices
    zncc: Array
    spread_odom: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.spread_odom) < len(self.ids):
            object.__setattr__(self, "spread_odom", np.zeros((len(self.ids), 3)))

    @classmethod
    def of(
        cls, landmarks: Landmarks, rows: Indices, pixels: Array, disparity_px: Array,
        sigma_px: Array, features: Indices | None = None, zncc: Array | None = None,
    ) -> Self:  # fmt: skip
        """Make matches of rows of the landmarks, by default without feature or correlation."""
        return cls(
            ids=landmarks.ids[rows],
            pixels=pixels,
            disparity_px=disparity_px,
            sigma_px=sigma_px,
            rows=rows,
            points_odom=landmarks.points_odom[rows],
            spread_odom=landmarks.spread_odom[rows],
            features=np.full(len(rows), NO_FEATURE) if features is None else features,
            zncc=np.full(len(rows), np.nan) if zncc is None else zncc,
        )

    @property
    def observations(self) -> Observations:
        """The observations without what concerns the map."""
        return Observations(
            self.ids, self.pixels, self.disparity_px, self.inlier, self.sigma_px, self.shift_px
        )

    def merge(self, other: Self) -> Self:
        """Add matches of other landmarks, sorted by landmark."""
        both = self.extend(other)
        return both.select(np.argsort(both.rows))

    def renew(self, landmarks: Landmarks) -> Self:
        """Match the same landmarks in a map that has moved, or has lost some of them."""
        rows = find_sorted(landmarks.ids, self.ids)
        kept = self.select(rows >= 0)
        rows = rows[rows >= 0]
        points, spread = landmarks.points_odom[rows], landmarks.spread_odom[rows]
        return replace(kept, rows=rows, points_odom=points, spread_odom=spread)


def newest_matches(local_map: LocalMap) -> Matches:
    """Matches of a map's first keyframe with its own landmarks."""
    seen, rows = local_map.keyframes[-1].observations, np.arange(len(local_map.landmarks))
    return Matches.of(local_map.landmarks, rows, seen.pixels, seen.disparity_px, seen.sigma_px)
