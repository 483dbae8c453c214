"""Data association: landmarks to their pixels in a view, by prediction, matching and alignment."""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig
from vo.map.frame import NO_FEATURE, Matches, View
from vo.map.local_map import Landmarks, LocalMap, TrackedFrame
from vo.patches.alignment import Alignment, align
from vo.patches.templates import extract_templates
from vo.patches.zncc import match_mutual
from vo.stereo.sparse import measure_disparities

NEIGHBOURS = 40
"""Matches of about the disparity of a landmark, whose correlations set its threshold."""

MAX_CLOSURE_PX = 0.75
"""Largest difference of a landmark's positions by its template and by the previous frame."""


def find_matches(
    local_map: LocalMap, view: View, T_odom_cam: Array, search_radius_px: float
) -> Matches:
    """Match landmarks with features near their projections by a predicted pose (4, 4).

    The search window has sides of twice the radius. Matches whose aligned patch does not correlate
    with the landmark's template are dropped.
    """
    landmarks, features, s = local_map.landmarks, view.features, view.settings.matching
    expected = project_landmarks(landmarks, T_odom_cam, view.rig)[:, :2]
    rows, found = match_mutual(
        landmarks.descriptors, expected, view.descriptors, features, search_radius_px, s
    ).T
    return _measure(local_map, view, T_odom_cam, rows, found, features[found], s.min_align_zncc)


def find_guided_matches(
    local_map: LocalMap, view: View, T_odom_cam: Array, matches: Matches
) -> Matches:
    """Add the landmarks without a matching feature, at their projections by a good pose (F5).

    The pose (4, 4) is right to within about a pixel; the known matches, at least one, stay.
    """
    expected = project_landmarks(local_map.landmarks, T_odom_cam, view.rig)
    visible = in_view(expected, view)
    visible[matches.rows] = False
    rows = np.flatnonzero(visible)
    none = np.full(len(rows), NO_FEATURE)
    # Without a feature, only the correlation tells a landmark from what now lies in its place.
    quantile = view.settings.matching.guided_quantile
    min_zncc = _correlation_of_neighbours(matches, expected[:, 2], rows, quantile)
    more = _measure(local_map, view, T_odom_cam, rows, none, expected[rows, :2], min_zncc)
    return matches.merge(more.select(~np.isnan(more.disparity_px)))


def _correlation_of_neighbours(
    matches: Matches, disparity_px: Array, rows: Indices, quantile: float
) -> Array:
    """Correlation (N,) that landmarks need: a quantile over the matches of about their disparity.

    Near landmarks change more from view to view, and determine most of the translation. There is
    at least one match; `disparity_px` is (L,) of all landmarks of the map, `rows` (N,).
    """
    order = np.argsort(disparity_px[matches.rows])
    neighbours = sliding_window_view(matches.zncc[order], min(NEIGHBOURS, len(matches)))
    zncc = np.quantile(neighbours, quantile, axis=1)
    place = np.searchsorted(disparity_px[matches.rows][order], disparity_px[rows])
    return zncc[np.clip(place - neighbours.shape[1] // 2, 0, len(neighbours) - 1)]


def is_consistent(
    matches: Matches, landmarks: Landmarks, previous: TrackedFrame, view: View
) -> Mask:
    """Which matches (N,) the previous frame, aligned with this one, confirms (5.1.2, F4).

    A landmark that no frame has matched yet is kept; one that only earlier frames matched is not.
    """
    keep = landmarks.views[matches.rows] == 1
    seen = previous.observations
    _, now, then = np.intersect1d(matches.ids, seen.ids, assume_unique=True, return_indices=True)
    patch_px = view.settings.matching.align_px
    templates = extract_templates(previous.left, seen.pixels[then], patch_px)
    direct = align(templates, view.frame.left, matches.pixels[now]).pixels
    with np.errstate(invalid="ignore"):
        error_px = np.abs(direct - matches.pixels[now]).max(axis=1)
        keep[now] = error_px < MAX_CLOSURE_PX  # not NaN
    return keep


def project_landmarks(landmarks: Landmarks, T_odom_cam: Array, rig: StereoRig) -> Array:
    """Project landmarks: (N, 3) left-image u, v and disparity, NaN behind the camera."""
    return rig.project(se3.transform(se3.inverse(T_odom_cam), landmarks.points_odom))


def in_view(expected: Array, view: View) -> Mask:
    """Which of (N, 3) projections lie in the left image."""
    u, v, disparity_px = expected.T
    height, width = view.frame.left.shape
    inside = (u > -0.5) & (v > -0.5) & (u < width - 0.5) & (v < height - 0.5)  # not NaN
    return inside & (disparity_px > 0)


def add_observations(local_map: LocalMap, view: View, matches: Matches) -> LocalMap:
    """Count a view of the matched landmarks; renew the descriptors of those with a feature."""
    views = local_map.landmarks.views[matches.rows] + 1
    landmarks = local_map.landmarks.update(matches.rows, views=views)
    matched = matches.features >= 0
    descriptors = view.descriptors[matches.features[matched]]
    landmarks = landmarks.update(matches.rows[matched], descriptors=descriptors)
    return replace(local_map, landmarks=landmarks)


def _measure(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, features: Indices,
    start: Array, min_zncc: Array | float,
) -> Matches:  # fmt: skip
    """Align landmarks in both images from where they are expected; keep those that correlate."""
    s = view.settings
    if s.matching.align:
        aligned = _align(local_map, view, T_odom_cam, rows, start)
    else:
        n = len(rows)
        aligned = Alignment(start, np.ones(n), np.zeros((n, 2, 2)))
    with np.errstate(invalid="ignore"):
        good = aligned.zncc > min_zncc
        good &= np.abs(aligned.pixels - start).max(axis=1) < s.matching.max_align_shift_px
    rows, features, pixels = rows[good], features[good], aligned.pixels[good]
    found = local_map.landmarks.select(rows)
    stereo = measure_disparities(
        view.frame, view.dense, pixels, s.stereo,
        expected_px=project_landmarks(found, T_odom_cam, view.rig)[:, 2],
        slopes=found.anchor_slopes,
    )  # fmt: skip
    variance = np.diagonal(aligned.covariance_px2[good], axis1=1, axis2=2)
    sigma_px = measurement_sigma(variance, stereo.sigma_px, local_map.noise, s.refinement)
    zncc, landmarks = aligned.zncc[good], local_map.landmarks
    return Matches.of(landmarks, rows, pixels, stereo.values_px, sigma_px, features, zncc)


def measurement_sigma(
    variance_px2: Array, disparity_px: Array, noise: tuple[float, float], s: RefinementSettings
) -> Array:
    """Standard deviations (N, 3) of u, v and disparity: image noise, and a constant share.

    Image noise gives the variance (N, 2) of u and v, and the standard deviation (N,) of the
    disparity, NaN where unknown. `noise` has the factors that are learnt from residuals.
    """
    pixels = noise[0] * np.sqrt(variance_px2 + s.sigma_px**2)
    return np.column_stack([pixels, noise[1] * np.hypot(disparity_px, s.sigma_disparity_px)])


def _align(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, start: Array
) -> Alignment:
    """Align the templates of landmarks (N,) with the left image."""
    landmarks, n = local_map.landmarks.select(rows), len(rows)
    result = Alignment(np.full((n, 2), np.nan), np.full(n, np.nan), np.full((n, 2, 2), np.nan))
    for keyframe in local_map.keyframes:
        here = landmarks.anchor == keyframe.serial
        anchored = landmarks.select(here)
        T_cam_anchor = se3.inverse(T_odom_cam) @ keyframe.T_odom_cam
        warp = _plane_warp(anchored, T_cam_anchor, view.rig)
        patch_px = view.settings.matching.align_px
        templates = extract_templates(keyframe.left, anchored.anchor_pixels, patch_px)
        aligned = align(templates, view.frame.left, start[here], warp)
        for values, found in zip(result, aligned, strict=True):
            values[here] = found
    return result


def _plane_warp(landmarks: Landmarks, T_cam_anchor: Array, rig: StereoRig) -> Array:
    """Warp of a slanted patch in the anchor's image on its way to another camera.

    Inverse depth is linear in the pixels of a plane, so with m = (x / z, y / z, 1) in the anchor,
    h = R m + t / z is linear too, and the plane's homography is (h_x / h_z, h_y / h_z). The result
    (N, 3, 2) is as `vo.patches.alignment.align` takes it.
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
