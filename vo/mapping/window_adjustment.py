"""Refining motion and structure of the last keyframes (thesis 3.4, 4.4)."""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import misfit, refine_structure
from vo.bundle_adjustment.fixed_lag import FixedLag
from vo.bundle_adjustment.problem import MIN_POINTS, Sight, collect
from vo.config import OdometrySettings, RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig
from vo.map.local_map import Keyframe, Landmarks, LocalMap, visibility

LEARNING = 0.2
"""How far one refinement moves what is believed of the noise, in the logarithm."""


def refine_map(
    local_map: LocalMap, rig: StereoRig, settings: OdometrySettings
) -> tuple[LocalMap, int]:
    """Refine the last keyframes and the landmarks that were seen often enough.

    A landmark takes part if at least `min_views` frames saw it, two of them keyframes. The others
    move rigidly with their anchor.

    Returns:
        The refined map and the iterations that it took, 0 if there was nothing to refine.
    """
    if settings.refinement.mode in ("none", "motion"):
        return local_map, 0
    refine = _refine_window if settings.refinement.mode == "window" else _refine_incrementally
    return refine(local_map, rig, settings.refinement)


def _refine_window(
    local_map: LocalMap, rig: StereoRig, s: RefinementSettings
) -> tuple[LocalMap, int]:
    """All of the window at once.

    The oldest keyframe stays, the second too where nothing else tells the scale, and so does one
    that sees too few of the landmarks to be determined.
    """
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    ids, counts = _choose(keyframes, landmarks, s)
    fixed = counts < MIN_POINTS
    fixed[: 1 if s.use_disparity else 2] = True
    if fixed.all():
        return local_map, 0
    points = landmarks.points_odom[np.searchsorted(landmarks.ids, ids)]
    bundle = collect([_sight(k) for k in keyframes], ids, points, fixed, rig)
    refined = refine_structure(bundle, s)
    spread = [
        _carried(keyframes[0], k, T, own)
        for k, T, own in zip(keyframes, refined.T_world_cam, refined.covariance, strict=True)
    ]
    moved = _moved(local_map, refined.T_world_cam, spread, ids, refined.points_world)
    return _with_noise(moved, refined.misfit, s), refined.iterations


def _refine_incrementally(
    local_map: LocalMap, rig: StereoRig, s: RefinementSettings
) -> tuple[LocalMap, int]:
    """The newest keyframe into the smoother; a smoother that fails starts anew from here."""
    lag = local_map.lag
    first = lag.first if lag else local_map.keyframes[-2:][0].serial
    keyframes = tuple(k for k in local_map.keyframes if k.serial >= first)
    ids, counts = _choose(keyframes, local_map.landmarks, s, lag)
    if len(keyframes) < 2 or counts[-1] < MIN_POINTS:
        return replace(local_map, lag=None), 0
    lag = lag or FixedLag(first, keyframes[0].T_odom_cam, keyframes[0].covariance, s.window)
    points = local_map.landmarks.points_odom[np.searchsorted(local_map.landmarks.ids, ids)]
    sights = {k.serial: _sight(k) for k in keyframes}
    try:
        found = lag.update(sights, ids, points, rig, s)
    except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own here
        return replace(local_map, lag=None), s.max_iterations
    unmoved = local_map.keyframes[: -len(keyframes)]
    T = [k.T_odom_cam for k in unmoved] + list(found.T_odom_cam)
    spread = [k.covariance for k in unmoved] + list(found.covariance)
    moved = _moved(local_map, np.array(T), spread, found.ids, found.estimates.points)
    noise = misfit([found.estimates], found.T_odom_cam)
    return _with_noise(replace(moved, lag=lag), noise, s), found.iterations


def _choose(
    keyframes: tuple[Keyframe, ...],
    landmarks: Landmarks,
    s: RefinementSettings,
    lag: FixedLag | None = None,
) -> tuple[Indices, Indices]:
    """Ids (J,) of the landmarks to refine, and how many of them each keyframe sees (K,)."""
    ids, mask = visibility(keyframes)
    often = landmarks.ids[landmarks.views >= s.min_views]
    chosen = np.isin(ids, often) & (mask.sum(axis=1) >= 2)
    if lag:
        chosen &= ~np.isin(ids, lag.spent)
    return ids[chosen], mask[chosen].sum(axis=0)


def _sight(keyframe: Keyframe) -> Sight:
    return Sight(keyframe.T_odom_cam, keyframe.ids, keyframe.measured, keyframe.sigma)


def _moved(
    local_map: LocalMap, T_odom_cam: Array, covariance: list[Array], ids: Indices,
    points_odom: Array,
) -> LocalMap:  # fmt: skip
    """Put keyframes and refined landmarks where they belong, the others with their anchors."""
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    moved = T_odom_cam @ se3.inverse(np.stack([k.T_odom_cam for k in keyframes]))
    anchor = landmarks.anchor - keyframes[0].serial
    points = np.einsum("nij,nj->ni", moved[anchor, :3, :3], landmarks.points_odom)
    points += moved[anchor, :3, 3]
    points[np.searchsorted(landmarks.ids, ids)] = points_odom
    keyframes = tuple(
        replace(k, T_odom_cam=T, covariance=spread)
        for k, T, spread in zip(keyframes, T_odom_cam, covariance, strict=True)
    )
    return replace(local_map, keyframes=keyframes, landmarks=replace(landmarks, points_odom=points))


def _with_noise(local_map: LocalMap, found: Array, s: RefinementSettings) -> LocalMap:
    """Follow the residuals slowly, and not below half of what is assumed."""
    if not s.learn_noise:
        return local_map
    factor = np.where(np.isfinite(found), np.maximum(found, 1e-3), 1.0) ** (LEARNING / 2)
    pixels, disparities = np.clip(np.array(local_map.noise) * factor, 0.5, 10.0)
    return replace(local_map, noise=(float(pixels), float(disparities)))


def _carried(oldest: Keyframe, keyframe: Keyframe, T_odom_cam: Array, relative: Array) -> Array:
    """Covariance of a refined keyframe: what the oldest one's becomes there, and its own."""
    if not relative.any():  # it was not refined
        return keyframe.covariance
    T_cam_oldest = se3.inverse(T_odom_cam) @ oldest.T_odom_cam
    return se3.transform_covariance(T_cam_oldest, oldest.covariance) + relative
