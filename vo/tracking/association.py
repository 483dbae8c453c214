"""Data association: landmarks to their pixels in a view, by prediction, matching and alignment."""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings, RefinementSettings
from vo.contract.arrays import Array, Indices, Mask, choose_in_turn
from vo.contract.compilation import compiled
from vo.contract.projection import project_points
from vo.map.frame import NO_FEATURE, Matches, View
from vo.map.local_map import Landmarks, LocalMap, TrackedFrame
from vo.patches.alignment import Alignment, align
from vo.patches.templates import extract_templates
from vo.patches.zncc import match_mutual
from vo.stereo.rolling_shutter import see_by_rows
from vo.stereo.sparse import measure_disparities
from vo.tracking.landmark_alignment import align_landmarks

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
    expected = project_landmarks(landmarks, T_odom_cam, view)[:, :2]
    rows, found = match_mutual(
        landmarks.descriptors, expected, view.descriptors, features, search_radius_px, s
    ).T
    return measure_matches(
        local_map, view, T_odom_cam, rows, found, features[found], s.min_align_zncc, is_exact=False
    )


def find_guided_matches(
    local_map: LocalMap, view: View, T_odom_cam: Array, matches: Matches
) -> Matches:
    """Add the landmarks without a matching feature, at their projections by a good pose (F5).

    The pose (4, 4) is right to within about a pixel; the known matches, at least one, stay.
    """
    expected = project_landmarks(local_map.landmarks, T_odom_cam, view)
    visible = in_view(expected, view)
    visible[matches.rows] = False
    rows = np.flatnonzero(visible)
    none = np.full(len(rows), NO_FEATURE)
    # Without a feature, only the correlation tells a landmark from what now lies in its place.
    quantile = view.settings.matching.guided_quantile
    min_zncc = _correlation_of_neighbours(matches, expected[:, 2], rows, quantile)
    more = measure_matches(local_map, view, T_odom_cam, rows, none, expected[rows, :2], min_zncc)
    return matches.merge(more.select(~np.isnan(more.disparity_px)))


def find_visible(
    local_map: LocalMap, view: View, T_odom_cam: Array, expected: Array, rows: Indices,
    known: Mask,
) -> Matches:  # fmt: skip
    """Find rows of the landmarks at their projections (L, 3) by a pose right to about a pixel.

    Those of the landmarks (L,) that are not known from the previous frame need a disparity, and
    the correlation of known ones of about their own.
    """
    s = view.settings.matching
    none, start = np.full(len(rows), NO_FEATURE), expected[rows, :2]
    found = measure_matches(local_map, view, T_odom_cam, rows, none, start, s.min_align_zncc)
    known = known[found.rows]
    if not known.any():
        return found
    min_zncc = _correlation_of_neighbours(
        found.select(known), expected[:, 2], found.rows, s.guided_quantile
    )
    return found.select(known | (found.zncc > min_zncc) & ~np.isnan(found.disparity_px))


def spread(
    rows: Indices, expected: Array, first: Mask, count: int, settings: OdometrySettings,
    worth: Array | None = None,
) -> Indices:  # fmt: skip
    """Select at most `count` of some rows of landmarks, ascending, from every part of the image.

    In every cell those of a mask (L,) come first, and of these those that are worth (L,) most, or
    else the nearest. The landmarks are expected at u, v and disparity, (L, 3).
    """
    if len(rows) <= count:
        return rows
    cells = np.maximum(expected[rows, :2] // settings.features.cell_px, 0).astype(np.int64)
    groups = cells[:, 1] * (cells[:, 0].max() + 1) + cells[:, 0]
    worth = expected[:, 2] if worth is None else worth
    # Those that come first count for more than any other.
    order = np.argsort(-worth[rows] - first[rows] * 1e6, kind="stable")
    return np.sort(rows[order[choose_in_turn(groups[order], count)]])


def _correlation_of_neighbours(
    matches: Matches, disparity_px: Array, rows: Indices, quantile: float
) -> Array:
    """Correlation (N,) that landmarks need: a quantile over the matches of about their disparity.

    Near landmarks change more from view to view, and determine most of the translation. There is
    at least one match; `disparity_px` is (L,) of all landmarks of the map, `rows` (N,).
    """
    near = disparity_px[matches.rows]
    order = np.argsort(near)
    place = np.searchsorted(near[order], disparity_px[rows])
    return _quantiles_about(matches.zncc[order], place, quantile)


@compiled()
def _quantiles_about(values: Array, place: Indices, quantile: float) -> Array:
    """Quantile (N,) of the `NEIGHBOURS` values (M,) about each place (N,) among them."""
    count = min(NEIGHBOURS, len(values))
    low = int(quantile * (count - 1))
    high, share = min(low + 1, count - 1), quantile * (count - 1) - low
    found = np.empty(len(values) - count + 1)  # by the first of the neighbours
    ordered = np.sort(values[:count])
    for first in range(len(found)):
        if first > 0:  # one value leaves, another comes, the others stay in order
            k = np.searchsorted(ordered, values[first - 1])
            new = values[first + count - 1]
            while k + 1 < count and ordered[k + 1] < new:
                ordered[k] = ordered[k + 1]
                k += 1
            while k > 0 and ordered[k - 1] > new:
                ordered[k] = ordered[k - 1]
                k -= 1
            ordered[k] = new
        found[first] = (1 - share) * ordered[low] + share * ordered[high]
    result = np.empty(len(place))
    for i in range(len(place)):
        result[i] = found[min(max(place[i] - count // 2, 0), len(values) - count)]
    return result


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


def project_landmarks(landmarks: Landmarks, T_odom_cam: Array, view: View) -> Array:
    """Project landmarks to where a view sees them: (N, 3) left-image u, v and disparity.

    NaN behind the camera.
    """
    expected = project_points(landmarks.points_odom, T_odom_cam, view.rig)
    return expected if view.velocity is None else see_by_rows(expected, view.rig, view.velocity)


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
    matched = matches.features != NO_FEATURE
    if not matched.any():
        return replace(local_map, landmarks=landmarks)
    descriptors = view.descriptors[matches.features[matched]]
    landmarks = landmarks.update(matches.rows[matched], descriptors=descriptors)
    return replace(local_map, landmarks=landmarks)


def measure_matches(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, features: Indices,
    start: Array, min_zncc: Array | float, is_exact: bool = True,
) -> Matches:  # fmt: skip
    """Align landmarks in both images from where they are expected; keep those that correlate.

    The pose is exact to about a pixel, or else disparities are searched for.
    """
    s = view.settings
    if s.matching.align:
        aligned = align_landmarks(local_map, view, T_odom_cam, rows, start)
    else:
        n = len(rows)
        aligned = Alignment(start, np.ones(n), np.zeros((n, 2, 2)))
    with np.errstate(invalid="ignore"):
        good = aligned.zncc > min_zncc
        good &= np.abs(aligned.pixels - start).max(axis=1) < s.matching.max_align_shift_px
    rows, features, pixels = rows[good], features[good], aligned.pixels[good]
    landmarks = local_map.landmarks
    points, slopes = landmarks.points_odom[rows], landmarks.anchor_slopes[rows]
    stereo = measure_disparities(
        view.frame, view.dense, pixels, s.stereo,
        expected_px=project_points(points, T_odom_cam, view.rig)[:, 2], slopes=slopes,
        is_exact=is_exact,
    )  # fmt: skip
    variance = np.diagonal(aligned.covariance_px2[good], axis1=1, axis2=2)
    sigma_px = measurement_sigma(variance, stereo.sigma_px, local_map.noise, s.refinement)
    zncc = aligned.zncc[good]
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
