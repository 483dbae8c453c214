"""Keyframes: when a view becomes one, and the landmarks that it adds to the map (thesis 3.4)."""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.compilation import compiled
from vo.contract.observations import Observations
from vo.hooks import NO_HOOKS, Hooks
from vo.map.frame import Matches, View
from vo.map.local_map import Keyframe, Landmarks, LocalMap, renewed_map
from vo.stereo.plane_fit import fit_plane_slopes
from vo.stereo.relief import has_relief
from vo.stereo.rolling_shutter import shift_to_instant
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import measurement_sigma
from vo.tracking.diagnostics import exceeds_iterations
from vo.tracking.hooked import announce_landmarks, replace_disparities
from vo.tracking.pose_refinement import row_shift
from vo.tracking.tracked import Tracked

ENOUGH_FLAT = 0.5
"""Landmarks on flat patches, over `features.count`, above which no new ones are made elsewhere."""


def needs_keyframe(tracked: Tracked) -> bool:
    """Whether a tracked view becomes a keyframe (3.4): it is new, and its pose converged (5.3)."""
    settings = tracked.view.settings
    converged = not exceeds_iterations(tracked.counts["motion iterations"], settings)
    return converged and tracked.is_new


def add_keyframe(
    local_map: LocalMap,
    view: View,
    T_odom_cam: Array,
    covariance: Array,
    inliers: Matches | None = None,
    hooks: Hooks = NO_HOOKS,
) -> LocalMap:
    """Append a view as a keyframe, with new landmarks on features that matched nothing.

    The oldest keyframe beyond the window is dropped. Landmarks whose template has changed its
    scale too much, or was dropped, take the new keyframe as their anchor if it observes them, and
    are removed otherwise. The map starts anew after `refinement.map_reset_keyframes`.

    The pose is (4, 4), its covariance (6, 6). The first keyframe of a map has no inliers.
    """
    settings, serial = view.settings, local_map.next_serial
    if 0 < settings.refinement.map_reset_keyframes <= serial - local_map.first_serial:
        # The firewall of Nistér, Naroditsky and Bergen, 2004: no error reaches beyond it.
        local_map, inliers = renewed_map(local_map), None
    observations, slopes, descriptors = _new_observations(view, inliers, local_map, hooks)
    at_instant = observations.at_instant
    points_cam = view.rig.triangulate(at_instant[:, :2], at_instant[:, 2])
    n = len(observations)
    # To first order, a depth errs by the share of it by which its disparity does.
    spread_cam = points_cam * (observations.sigma_px[:, 2] / at_instant[:, 2])[:, None]
    new = Landmarks(
        ids=observations.ids,
        points_odom=se3.transform(T_odom_cam, points_cam),
        spread_odom=spread_cam @ T_odom_cam[:3, :3].T,
        descriptors=descriptors,
        views=np.ones(n, dtype=np.int64),
        anchor=np.full(n, serial),
        anchor_pixels=observations.pixels,
        anchor_depth_m=points_cam[:, 2],
        anchor_slopes=slopes,
    )
    announce_landmarks(hooks, view.frame, new.ids, new.anchor_pixels)
    if inliers:
        inliers = replace(inliers, shift_px=row_shift(T_odom_cam, inliers, view))
        observations = inliers.observations.extend(observations)
    keyframe = Keyframe(view.frame.left, observations, serial, T_odom_cam, covariance, view.path_px)
    keyframes = (*local_map.keyframes, keyframe)[-settings.refinement.window :]
    known = local_map.landmarks
    if inliers:
        known = _renew_anchors(known, inliers, keyframe, keyframes[0].serial, settings)
    known = known.select(known.anchor >= keyframes[0].serial)
    return replace(
        local_map,
        keyframes=keyframes,
        landmarks=known.extend(new),
        next_serial=serial + 1,
        next_id=local_map.next_id + n,
    )


def _new_observations(
    view: View, inliers: Matches | None, local_map: LocalMap, hooks: Hooks
) -> tuple[Observations, Array, Array]:
    """Features that have a depth and lie apart from the inliers, as landmarks of the next ids.

    N observations, the (N, 2) slopes of the disparity and (N, P) descriptors.
    """
    s, pixels = view.settings, view.features
    taken = inliers.measured if inliers else np.zeros((0, 3))
    free = _lie_apart(pixels, taken, s.features.min_distance_px)
    pixels, descriptors = pixels[free], view.descriptors[free]
    found = measure_disparities(view.frame, view.dense, pixels, s.stereo, nearby=taken)
    found = replace_disparities(hooks, view.frame, pixels, found, s.stereo)
    known = found.known
    flat = known & ~has_relief(found)
    if flat.sum() + len(taken) >= ENOUGH_FLAT * s.features.count:
        known = flat
    n = int(known.sum())
    # A new landmark is wherever its template was cut: its pixel has no error of its own.
    exact, disparity_sigma = np.zeros((n, 2)), found.sigma_px[known]
    observations = Observations(
        ids=local_map.next_id + np.arange(n),
        pixels=pixels[known],
        disparity_px=found.values_px[known],
        sigma_px=measurement_sigma(exact, disparity_sigma, local_map.noise, s.refinement),
    )
    if view.velocity is not None:
        shift_px = shift_to_instant(observations.measured, view.rig, view.velocity)
        observations = replace(observations, shift_px=shift_px)
    return observations, found.slopes[known], descriptors[known]


@compiled()
def _lie_apart(pixels: Array, others: Array, distance_px: float) -> Mask:
    """Which pixels (N, 2) are further than a distance from all others (M, 2 or more)."""
    apart = np.ones(len(pixels), dtype=np.bool_)
    for i in range(len(pixels)):
        u, v, near = pixels[i, 0], pixels[i, 1], 0
        for j in range(len(others)):
            du, dv = others[j, 0] - u, others[j, 1] - v
            near += du * du + dv * dv <= distance_px * distance_px
        apart[i] = near == 0
    return apart


def _renew_anchors(
    landmarks: Landmarks, seen: Matches, keyframe: Keyframe, oldest: int,
    settings: OdometrySettings,
) -> Landmarks:  # fmt: skip
    """Cut new templates for the seen landmarks whose old one is worn or about to be dropped."""
    depth_m = se3.transform(se3.inverse(keyframe.T_odom_cam), seen.points_odom)[:, 2]
    zoom = landmarks.anchor_depth_m[seen.rows] / depth_m
    worn = np.maximum(zoom, 1 / zoom) > settings.matching.max_zoom
    worn |= landmarks.anchor[seen.rows] < oldest
    pixels, disparity_px = keyframe.observations.pixels, keyframe.observations.disparity_px
    return landmarks.update(
        seen.rows[worn],
        anchor=np.full(worn.sum(), keyframe.serial),
        anchor_pixels=seen.pixels[worn],
        anchor_depth_m=depth_m[worn],
        anchor_slopes=fit_plane_slopes(
            seen.pixels[worn], seen.disparity_px[worn], pixels, disparity_px
        ),
    )
