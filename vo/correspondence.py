"""From landmarks to their pixels in a new view: prediction, marriage, sub-pixel alignment."""

from dataclasses import dataclass

import numpy as np

from vo.alignment import align
from vo.config import MatchingSettings, OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.rig import StereoRig
from vo.matching import marry
from vo.stereo import disparity_at
from vo.tracks import Landmarks, LocalMap
from vo.view import View

WARP_STEP_PX = 4.0
"""Distance between the points of a surface whose images tell how a patch deforms."""


@dataclass(frozen=True)
class Matches:
    """Landmarks found in a view, row by row.

    Attributes:
        rows: (N,) rows of the map's landmarks, ascending.
        ids: (N,) their identifiers.
        points_odom: (N, 3) their positions, metres.
        features: (N,) rows of the view's features.
        pixels: (N, 2) left-image (u, v), sub-pixel.
        disparity_px: (N,) NaN where unknown.
    """

    rows: Indices
    ids: Indices
    points_odom: Array
    features: Indices
    pixels: Array
    disparity_px: Array

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def measured(self) -> tuple[Array, Array, Array]:
        """Points, pixels and disparities: what a pose is refined on."""
        return self.points_odom, self.pixels, self.disparity_px

    def select(self, keep: Mask) -> "Matches":
        """Keep some rows."""
        return Matches(**{name: value[keep] for name, value in vars(self).items()})


def find_matches(
    local_map: LocalMap,
    view: View,
    T_odom_cam: Array,
    reach_px: float,
    rig: StereoRig,
    settings: OdometrySettings,
) -> Matches:
    """Match landmarks with features near where a guessed pose puts them.

    Args:
        local_map: Landmarks, and the keyframes that hold their templates.
        view: The new frame.
        T_odom_cam: (4, 4) guessed pose.
        reach_px: Radius of the search window.
        rig: Projects.
        settings: Patch sizes and least correlations.

    Returns:
        Those whose aligned patch still resembles the landmark's template.
    """
    landmarks, features = local_map.landmarks, view.features
    points_cam = se3.transform(se3.inverse(T_odom_cam), landmarks.points_odom)
    expected = rig.project(points_cam)[:, :2]
    rows, found = marry(
        landmarks.vectors, expected, view.vectors, features.pixels, reach_px, settings.matching
    ).T
    pixels = _align(
        local_map, rows, view.frame.left, features.pixels[found], T_odom_cam, rig, settings.matching
    )
    good = ~np.isnan(pixels[:, 0])
    rows, found, pixels = rows[good], found[good], pixels[good]
    disparity_px = disparity_at(view.frame, view.dense, pixels, settings.stereo)
    return Matches(
        rows, landmarks.ids[rows], landmarks.points_odom[rows], found, pixels, disparity_px
    )


def _align(
    local_map: LocalMap, rows: Indices, image: Image, start: Array, T_odom_cam: Array,
    rig: StereoRig, s: MatchingSettings,
) -> Array:  # fmt: skip
    """Align the templates of landmarks: (N, 2) pixels, NaN where the result is unlike or far."""
    landmarks = local_map.landmarks.select(rows)
    pixels, zncc = np.full((len(rows), 2), np.nan), np.full(len(rows), np.nan)
    for keyframe in local_map.keyframes:
        here = landmarks.anchor == keyframe.serial
        anchored = landmarks.select(here)
        T_cam_anchor = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
        warp = _surface_warp(anchored, T_cam_anchor, rig)
        pixels[here], zncc[here] = align(
            keyframe.left, anchored.anchor_pixels, image, start[here], warp, s.align_px
        )
    with np.errstate(invalid="ignore"):
        good = (zncc > s.align_zncc) & (np.abs(pixels - start).max(axis=1) < s.align_reach_px)
    return np.where(good[:, None], pixels, np.nan)


def _surface_warp(landmarks: Landmarks, T_cam_anchor: Array, rig: StereoRig) -> Array:
    """How a slanted patch in the anchor's image deforms on its way to another camera.

    Returns:
        (N, 2, 2) affine maps of pixel offsets, from the images of three points of the surface.
    """
    offsets = WARP_STEP_PX * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    pixels = landmarks.anchor_pixels[:, None] + offsets
    disparity_px = rig.f_px * rig.baseline_m / landmarks.anchor_depth_m[:, None]
    disparity_px = disparity_px + landmarks.anchor_slopes @ offsets.T
    moved = rig.project(se3.transform(T_cam_anchor, rig.triangulate(pixels, disparity_px)))[..., :2]
    return np.swapaxes(moved[:, 1:] - moved[:, :1], 1, 2) / WARP_STEP_PX
