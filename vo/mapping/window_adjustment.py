"""Bundle adjustment of the last keyframes and their landmarks (thesis 3.4, 4.4)."""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import refine_structure
from vo.bundle_adjustment.problem import MIN_POINTS, collect
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig
from vo.map.local_map import Keyframe, LocalMap, visibility

LEARNING_RATE = 0.2
"""Share of one adjustment's residuals in the logarithm of the learnt noise."""


def adjust_window(
    local_map: LocalMap, rig: StereoRig, settings: RefinementSettings
) -> tuple[LocalMap, int]:
    """Adjust the last keyframes and the landmarks that were seen often enough.

    A landmark takes part if at least `min_views` frames saw it, two of them keyframes. The others
    move rigidly with their anchor. The oldest keyframe stays, the second too where nothing else
    tells the scale, and so does one that sees too few of the landmarks to be determined.

    Returns:
        The adjusted map and the iterations that it took, 0 if there was nothing to adjust.
    """
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    ids, mask = select_landmarks(local_map, keyframes, settings)
    fixed = mask.sum(axis=0) < MIN_POINTS
    fixed[: 1 if settings.use_disparity else 2] = True
    if fixed.all():
        return local_map, 0
    points = landmarks.points_odom[np.searchsorted(landmarks.ids, ids)]
    T_odom_cam = np.stack([k.T_odom_cam for k in keyframes])
    bundle = collect(T_odom_cam, [k.observations for k in keyframes], ids, points, fixed, rig)
    refined = refine_structure(bundle, settings)
    covariance = [
        _covariance(keyframes[0], k, T, relative)
        for k, T, relative in zip(keyframes, refined.T_world_cam, refined.covariance, strict=True)
    ]
    moved = move_map(local_map, refined.T_world_cam, covariance, ids, refined.points_world)
    return learn_noise(moved, refined.misfit, settings), refined.iterations


def select_landmarks(
    local_map: LocalMap, keyframes: tuple[Keyframe, ...], settings: RefinementSettings
) -> tuple[Indices, Mask]:
    """Landmarks (J,) that take part in the adjustment of keyframes; visibility (J, K)."""
    ids, mask = visibility(keyframes)
    landmarks = local_map.landmarks
    often = landmarks.ids[landmarks.views >= settings.min_views]
    chosen = np.isin(ids, often) & (mask.sum(axis=1) >= 2)
    return ids[chosen], mask[chosen]


def move_map(
    local_map: LocalMap, T_odom_cam: Array, covariance: list[Array], ids: Indices,
    points_odom: Array,
) -> LocalMap:  # fmt: skip
    """Replace poses (K, 4, 4), covariances (6, 6), and the points (J, 3) of adjusted landmarks.

    The other landmarks move with their anchors.
    """
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    moved = T_odom_cam @ se3.inverse(np.stack([k.T_odom_cam for k in keyframes]))
    anchor = landmarks.anchor - keyframes[0].serial
    points = np.einsum("nij,nj->ni", moved[anchor, :3, :3], landmarks.points_odom)
    points += moved[anchor, :3, 3]
    points[np.searchsorted(landmarks.ids, ids)] = points_odom
    keyframes = tuple(
        replace(k, T_odom_cam=T, covariance=C)
        for k, T, C in zip(keyframes, T_odom_cam, covariance, strict=True)
    )
    return replace(local_map, keyframes=keyframes, landmarks=replace(landmarks, points_odom=points))


def learn_noise(local_map: LocalMap, misfit: Array, settings: RefinementSettings) -> LocalMap:
    """Adapt the noise to (2,) misfits of pixels and disparities, slowly and within limits."""
    if not settings.learn_noise:
        return local_map
    factor = np.where(np.isfinite(misfit), np.maximum(misfit, 1e-3), 1.0) ** (LEARNING_RATE / 2)
    pixels, disparities = np.clip(np.array(local_map.noise) * factor, 0.5, 10.0)
    return replace(local_map, noise=(float(pixels), float(disparities)))


def _covariance(oldest: Keyframe, keyframe: Keyframe, T_odom_cam: Array, relative: Array) -> Array:
    """Covariance of an adjusted keyframe: the oldest one's at that pose, plus the relative one."""
    if not relative.any():  # it was fixed
        return keyframe.covariance
    T_cam_oldest = se3.inverse(T_odom_cam) @ oldest.T_odom_cam
    return se3.transform_covariance(T_cam_oldest, oldest.covariance) + relative
