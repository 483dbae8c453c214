"""From landmarks to their pixels in a new view: prediction, marriage, sub-pixel alignment."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from vo.config import MatchingSettings, OdometrySettings, RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.rig import StereoRig
from vo.map.frame import View
from vo.map.local_map import Landmarks, LocalMap
from vo.patches.alignment import Alignment, align
from vo.patches.templates import extract_templates
from vo.patches.zncc import match_mutual
from vo.stereo.sparse import measure_disparities

NO_FEATURE = -1

PEERS = 40
"""Matches about as near as a landmark, beside which it must look alike."""


@dataclass(frozen=True)
class Matches:
    """Landmarks found in a view, row by row.

    Attributes:
        rows: (N,) rows of the map's landmarks, each once.
        ids: (N,) their identifiers.
        points_odom: (N, 3) their positions, metres.
        features: (N,) rows of the view's features, NO_FEATURE where none answered.
        measured: (N, 3) left-image u, v, sub-pixel, and disparity, NaN where unknown.
        sigma: (N, 3) their standard deviations, pixels.
        zncc: (N,) likeness to the landmark's template; NaN if that was not asked.
    """

    rows: Indices
    ids: Indices
    points_odom: Array
    features: Indices
    measured: Array
    sigma: Array
    zncc: Array

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def pixels(self) -> Array:
        """(N, 2) left-image (u, v)."""
        return self.measured[:, :2]

    def extend(self, other: "Matches") -> "Matches":
        """Append rows, and sort by landmark."""
        both = {k: np.concatenate([v, getattr(other, k)]) for k, v in vars(self).items()}
        order = np.argsort(both["rows"])
        return Matches(**{name: value[order] for name, value in both.items()})

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
    expected = expected_at(landmarks, T_odom_cam, rig)[:, :2]
    rows, found = match_mutual(
        landmarks.vectors, expected, view.vectors, features.pixels, reach_px, settings.matching
    ).T
    least = settings.matching.min_align_zncc
    start = features.pixels[found]
    return _measure(local_map, view, T_odom_cam, rows, found, start, least, rig, settings)


def find_more(
    local_map: LocalMap,
    view: View,
    T_odom_cam: Array,
    matches: Matches,
    rig: StereoRig,
    settings: OdometrySettings,
) -> Matches:
    """Add the landmarks that no feature answered to, where a good pose puts them (F5).

    Args:
        local_map: As for `find_matches`.
        view: The new frame.
        T_odom_cam: (4, 4) its pose, to within about a pixel.
        matches: What is matched already; stays as it is.
        rig: Projects.
        settings: As for `find_matches`.
    """
    expected = expected_at(local_map.landmarks, T_odom_cam, rig)
    visible = in_sight(expected, view.frame.left)
    visible[matches.rows] = False
    rows = np.flatnonzero(visible)
    nobody = np.full(len(rows), NO_FEATURE)
    # Without a feature to answer, only likeness tells a landmark from what now lies in its place.
    least = _likeness_of_peers(matches, expected[:, 2], rows, settings.matching.guided_quantile)
    start = expected[rows, :2]
    more = _measure(local_map, view, T_odom_cam, rows, nobody, start, least, rig, settings)
    return matches.extend(more.select(~np.isnan(more.measured[:, 2])))


def _likeness_of_peers(
    matches: Matches, disparity_px: Array, rows: Indices, quantile: float
) -> Array:
    """How alike (N,) some landmarks must be: as a share of the matches about as near.

    What is near changes more from view to view, and tells most of the translation.

    Args:
        matches: At least one.
        disparity_px: (L,) of all landmarks of the map, by the new pose.
        rows: (N,) of the landmarks that are asked about.
        quantile: Share of the matches that may be less alike.
    """
    order = np.argsort(disparity_px[matches.rows])
    peers = sliding_window_view(matches.zncc[order], min(PEERS, len(matches)))
    likeness = np.quantile(peers, quantile, axis=1)
    place = np.searchsorted(disparity_px[matches.rows][order], disparity_px[rows])
    return likeness[np.clip(place - peers.shape[1] // 2, 0, len(peers) - 1)]


def expected_at(landmarks: Landmarks, T_odom_cam: Array, rig: StereoRig) -> Array:
    """Where a pose puts landmarks: (N, 3) left-image u, v and disparity, NaN behind the camera."""
    return rig.project(se3.transform(se3.inverse(T_odom_cam), landmarks.points_odom))


def in_sight(expected: Array, image: Image) -> Mask:
    """Which of (N, 3) projections lie in an image."""
    height, width = image.shape
    with np.errstate(invalid="ignore"):
        inside = (expected[:, :2] > 0).all(axis=1) & (expected[:, 2] > 0)
        return inside & (expected[:, 0] < width) & (expected[:, 1] < height)


def _measure(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, features: Indices,
    start: Array, least_zncc: Array | float, rig: StereoRig, settings: OdometrySettings,
) -> Matches:  # fmt: skip
    """Align landmarks from where they are expected, in both eyes; drop those that look unlike."""
    landmarks = local_map.landmarks
    if settings.matching.align:
        aligned = _align(
            local_map, rows, view.frame.left, start, T_odom_cam, rig, settings.matching
        )
    else:
        n = len(rows)
        aligned = Alignment(start, np.ones(n), np.zeros((n, 2, 2)))
    with np.errstate(invalid="ignore"):
        good = aligned.zncc > least_zncc
        good &= np.abs(aligned.pixels - start).max(axis=1) < settings.matching.max_align_shift_px
    rows, features, pixels = rows[good], features[good], aligned.pixels[good]
    found = landmarks.select(rows)
    stereo = measure_disparities(
        view.frame, view.dense, pixels, settings.stereo,
        expected_px=expected_at(found, T_odom_cam, rig)[:, 2], slopes=found.anchor_slopes,
    )  # fmt: skip
    variance = np.diagonal(aligned.covariance_px2[good], axis1=1, axis2=2)
    return Matches(
        rows,
        found.ids,
        found.points_odom,
        features,
        np.column_stack([pixels, stereo.values_px]),
        measurement_sigma(variance, stereo.sigma_px, local_map.noise, settings.refinement),
        aligned.zncc[good],
    )


def measurement_sigma(
    variance_px2: Array, disparity_px: Array, noise: tuple[float, float], s: RefinementSettings
) -> Array:
    """Standard deviations (N, 3) of u, v and disparity: noise, and what warps do not explain.

    Args:
        variance_px2: (N, 2) of u and v by the noise of the images.
        disparity_px: (N,) standard deviation of the disparity by the same; NaN where unknown.
        noise: Factors of pixels and of disparities that residuals have shown.
        s: The rest, alike for all.
    """
    pixels = noise[0] * np.sqrt(variance_px2 + s.sigma_px**2)
    return np.column_stack([pixels, noise[1] * np.hypot(disparity_px, s.sigma_disparity_px)])


def _align(
    local_map: LocalMap, rows: Indices, image: Image, start: Array, T_odom_cam: Array,
    rig: StereoRig, s: MatchingSettings,
) -> Alignment:  # fmt: skip
    """Align the templates of landmarks with an image."""
    landmarks = local_map.landmarks.select(rows)
    n = len(rows)
    result = Alignment(np.full((n, 2), np.nan), np.full(n, np.nan), np.full((n, 2, 2), np.nan))
    for keyframe in local_map.keyframes:
        here = landmarks.anchor == keyframe.serial
        anchored = landmarks.select(here)
        T_cam_anchor = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
        warp = _surface_warp(anchored, T_cam_anchor, rig)
        templates = extract_templates(keyframe.left, anchored.anchor_pixels, s.align_px)
        for name, values in vars(align(templates, image, start[here], warp)).items():
            getattr(result, name)[here] = values
    return result


def _surface_warp(landmarks: Landmarks, T_cam_anchor: Array, rig: StereoRig) -> Array:
    """How a slanted patch in the anchor's image deforms on its way to another camera.

    Inverse depth is linear in the pixels of a plane, so with m = (x / z, y / z, 1) in the anchor,
    h = R m + t / z is linear too, and the plane's homography is (h_x / h_z, h_y / h_z).

    Returns:
        (N, 3, 2) warps as `vo.patches.alignment.align` takes them.
    """
    R, t = T_cam_anchor[:3, :3], T_cam_anchor[:3, 3]
    rays = rig.normalized(landmarks.anchor_pixels)
    m = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    h = m @ R.T + t / landmarks.anchor_depth_m[:, None]
    inverse_depth_slopes = landmarks.anchor_slopes / (rig.f_px * rig.baseline_m)
    dh = R[:, :2] / rig.f_px + t[:, None] * inverse_depth_slopes[:, None]  # (N, 3, 2) per pixel
    bend = dh[:, 2:] / h[:, 2, None, None]
    dx = dh[:, :2] / h[:, 2, None, None] - h[:, :2, None] / h[:, 2, None, None] * bend
    return np.concatenate([rig.f_px * dx, bend], axis=1)
