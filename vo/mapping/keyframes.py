"""Growing the local map by a keyframe (thesis 3.4)."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from vo.config import OdometrySettings, RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.hooks import UNTOUCHED, Hooks
from vo.map.frame import View
from vo.map.local_map import Keyframe, Landmarks, LocalMap, empty_map
from vo.stereo.plane_fit import fit_plane_slopes
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import Matches, measurement_sigma
from vo.tracking.replacement import replace_disparities

STANDING_PX = 1.0
"""Median flow since the last keyframe below which the camera has not moved: however few landmarks
are left, another keyframe would only add its own error (thesis 5.1.3)."""


def is_new_view(
    last: Keyframe, matches: Matches, settings: RefinementSettings, least: int = 0
) -> bool:
    """Whether a view has moved far enough from the last keyframe to become one itself.

    What a landmark says of the translation grows as its image motion does, with the disparity: the
    near ones, which soon leave the image, say most. Of those without disparity nothing is held.

    Args:
        last: The last keyframe.
        matches: Inliers of the view.
        settings: Median image motion that suffices, or share that is left of what the keyframe's
            landmarks said of the translation.
        least: Fewer inliers suffice too: an image that shows more is worth the step.
    """
    _, then, now = np.intersect1d(last.ids, matches.ids, assume_unique=True, return_indices=True)
    if len(then) == 0:
        return True
    flow_px = np.median(np.linalg.norm(matches.pixels[now] - last.measured[then, :2], axis=1))
    telling = np.nan_to_num(last.measured[:, 2]) ** 2
    few = (
        telling[then].sum() < settings.keyframe_tracked_ratio * telling.sum()
        or len(matches) < least
    )
    return bool(flow_px > (STANDING_PX if few else settings.keyframe_parallax_px))


def add_keyframe(
    local_map: LocalMap,
    view: View,
    T_odom_cam: Array,
    covariance: Array,
    matches: Matches | None,
    rig: StereoRig,
    settings: OdometrySettings,
    hooks: Hooks = UNTOUCHED,
) -> LocalMap:
    """Append a view as a keyframe, with fresh landmarks on features that matched nothing.

    The oldest keyframe beyond the window is dropped. Landmarks whose template has grown or
    shrunk too much, or was dropped, take the new keyframe as their anchor if it sees them, and
    are forgotten otherwise. At a firewall all are forgotten: the view starts the map anew, at its
    pose, so that no error of the structure reaches beyond (Nistér, Naroditsky and Bergen, 2004).

    Args:
        local_map: May be empty.
        view: The new keyframe's.
        T_odom_cam: (4, 4) its pose.
        covariance: (6, 6) of the pose.
        matches: Inliers of the view; None for none.
        rig: Triangulates.
        settings: The window, and how much a template may change.
        hooks: May replace disparities; hear of the fresh landmarks.
    """
    kept = settings.refinement.map_reset_keyframes
    if 0 < kept <= local_map.next_serial - local_map.first_serial:
        local_map = empty_map(local_map.next_serial, local_map.next_id, local_map.noise)
        matches = None
    serial, known = local_map.next_serial, local_map.landmarks
    taken = matches.measured if matches else np.zeros((0, 3))
    measured, sigma, slopes, vectors = _fresh_features(
        view, taken, local_map.noise, settings, hooks
    )
    points_cam = rig.triangulate(measured[:, :2], measured[:, 2])
    n = len(measured)
    fresh = Landmarks(
        ids=local_map.next_id + np.arange(n),
        points_odom=se3.transform(T_odom_cam, points_cam),
        vectors=vectors,
        views=np.ones(n, dtype=np.int64),
        anchor=np.full(n, serial),
        anchor_pixels=measured[:, :2],
        anchor_depth_m=points_cam[:, 2],
        anchor_slopes=slopes,
    )
    hooks.born(view.frame, fresh.ids, fresh.anchor_pixels)
    keyframe = Keyframe(serial, T_odom_cam, covariance, view.frame.left, fresh.ids, measured, sigma)
    if matches:
        keyframe = replace(
            keyframe,
            ids=np.concatenate([matches.ids, fresh.ids]),
            measured=np.concatenate([matches.measured, measured]),
            sigma=np.concatenate([matches.sigma, sigma]),
        )
    keyframes = (*local_map.keyframes, keyframe)[-settings.refinement.window :]
    if matches:
        known = _renew_anchors(known, matches, keyframe, keyframes[0].serial, settings)
    known = known.select(known.anchor >= keyframes[0].serial)
    return replace(
        local_map,
        keyframes=keyframes,
        landmarks=known.extend(fresh),
        next_serial=serial + 1,
        next_id=local_map.next_id + n,
    )


def _fresh_features(
    view: View, taken: Array, noise: tuple[float, float], settings: OdometrySettings, hooks: Hooks
) -> tuple[Array, Array, Array, Array]:
    """Features that have a depth and lie apart from the (N, 3) measurements taken.

    Returns:
        (N, 3) measurements, their (N, 3) sigmas, the disparity's (N, 2) slopes and (N, P)
        appearances.
    """
    pixels = view.features.pixels
    free = np.ones(len(pixels), dtype=bool)
    if len(taken):
        free = cKDTree(taken[:, :2]).query(pixels)[0] > settings.features.min_distance_px
    pixels, vectors = pixels[free], view.vectors[free]
    found = measure_disparities(view.frame, view.dense, pixels, settings.stereo, nearby=taken)
    found = replace_disparities(hooks, view.frame, pixels, found, settings.stereo)
    known = found.known
    measured = np.column_stack([pixels, found.values_px])[known]
    # A fresh landmark is wherever its template was cut: its pixel has no error of its own.
    sigma = measurement_sigma(
        np.zeros((known.sum(), 2)), found.sigma_px[known], noise, settings.refinement
    )
    return measured, sigma, found.slopes[known], vectors[known]


def _renew_anchors(
    landmarks: Landmarks, seen: Matches, keyframe: Keyframe, oldest: int,
    settings: OdometrySettings,
) -> Landmarks:  # fmt: skip
    """Take new templates for the seen landmarks whose old one is worn or about to be dropped."""
    depth_m = se3.transform(se3.inverse(keyframe.T_odom_cam), seen.points_odom)[:, 2]
    zoom = landmarks.anchor_depth_m[seen.rows] / depth_m
    worn = np.maximum(zoom, 1 / zoom) > settings.matching.max_zoom
    worn |= landmarks.anchor[seen.rows] < oldest
    return landmarks.update(
        seen.rows[worn],
        anchor=np.full(worn.sum(), keyframe.serial),
        anchor_pixels=seen.pixels[worn],
        anchor_depth_m=depth_m[worn],
        anchor_slopes=fit_plane_slopes(
            seen.pixels[worn],
            seen.measured[worn, 2],
            keyframe.measured[:, :2],
            keyframe.measured[:, 2],
        ),
    )
