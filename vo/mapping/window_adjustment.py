"""Bundle adjustment of the last keyframes and their landmarks (thesis 3.4, 4.4)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from vo.bundle_adjustment.adjust import Refined, misfit, refine_structure
from vo.bundle_adjustment.problem import MIN_POINTS, collect
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask, find_sorted
from vo.contract.rig import StereoRig
from vo.map.local_map import Keyframe, LocalMap, pose_covariance

if TYPE_CHECKING:
    from vo.bundle_adjustment.fixed_lag import FixedLag

LEARNING_RATE = 0.2
"""Share of one adjustment's residuals in the logarithm of the learnt noise."""

COMMON = 2.4
"""Square root of metres: variance of a window of 1 m over that of independent errors, where each
landmark's scores vary as assumed. It makes the NEES over 1 m about 6 (decision 51)."""

LEAST_EXCESS = 0.9
"""Excess of independent errors, some of which the loss has weighed down; less is chance."""

MIN_WINDOW_M = 0.25
"""Length of a window below which it counts as that long: turns on the spot."""

UNKNOWN = 1e-6
"""Least information along the spread of a landmark, in spreads: it grows no more than so much."""

Adjuster = Callable[[LocalMap], tuple[LocalMap, int]]
"""Function of a map, which returns the adjusted one and the iterations; 0 if nothing changed."""


def adjuster(rig: StereoRig, settings: RefinementSettings) -> Adjuster:
    """Make the bundle adjustment that follows a new keyframe, by `refinement.mode`."""
    if settings.mode == "fixed_lag":
        return IncrementalAdjustment(rig, settings)
    if settings.mode == "window":
        return partial(adjust_window, rig=rig, settings=settings)
    return lambda local_map: (local_map, 0)


def adjust_window(
    local_map: LocalMap, rig: StereoRig, settings: RefinementSettings
) -> tuple[LocalMap, int]:
    """Adjust the last keyframes and the landmarks that were seen often enough.

    A landmark takes part if at least `min_views` frames saw it, two of them keyframes. The others
    move rigidly with their anchor. The oldest keyframe stays, the second too where nothing else
    tells the scale, and so does one that sees too few of the landmarks to be determined.
    """
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    ids, mask = _select_landmarks(local_map, keyframes, settings)
    fixed = mask.sum(axis=0) < MIN_POINTS
    fixed[: 1 if settings.use_disparity else 2] = True
    if fixed.all():
        return local_map, 0
    points = landmarks.points_odom[np.searchsorted(landmarks.ids, ids)]
    T_odom_cam = np.stack([k.T_odom_cam for k in keyframes])
    bundle = collect(T_odom_cam, [k.observations for k in keyframes], ids, points, fixed, rig)
    refined = refine_structure(bundle, settings)
    covariance = [k.covariance for k in keyframes]
    if refined.covariance[-1].any():
        covariance[-1] = extend_covariance(keyframes, refined)
    points = refined.points_world, refined.information
    moved = _move_map(local_map, refined.T_world_cam, covariance, ids, *points)
    return _learn_noise(moved, refined.misfit, settings), refined.iterations


def extend_covariance(keyframes: tuple[Keyframe, ...], refined: Refined) -> Array:
    """Covariance (6, 6) of the newest keyframe: that of the one before, and what one step adds.

    Errors of a landmark's template are in all keyframes of a window that see it, so the sum of the
    covariances of its steps is no measure of the whole: a step adds its share of the whole. What
    templates have in common is in no residual, as the poses absorb it. It grows with what each
    repeats, and lasts beyond a window, the more so the shorter that is.
    """
    T_odom_cam = refined.T_world_cam
    length_m = max(np.linalg.norm(T_odom_cam[-1, :3, 3] - T_odom_cam[0, :3, 3]), MIN_WINDOW_M)
    excess = max(refined.excess[-1], LEAST_EXCESS)
    factor = max(COMMON * excess**2 / np.sqrt(length_m), 1.0)
    share = refined.covariance[-1] * factor / (len(keyframes) - 1)
    before = replace(keyframes[-2], T_odom_cam=T_odom_cam[-2])
    return pose_covariance(before, T_odom_cam[-1], share)


def _select_landmarks(
    local_map: LocalMap, keyframes: tuple[Keyframe, ...], settings: RefinementSettings
) -> tuple[Indices, Mask]:
    """Landmarks (J,) that take part in the adjustment of keyframes; visibility (J, K) (4.4)."""
    landmarks = local_map.landmarks
    places = [find_sorted(k.observations.ids, landmarks.ids) for k in keyframes]
    mask = np.stack(places, axis=1) >= 0
    chosen = (landmarks.views >= settings.min_views) & (mask.sum(axis=1) >= 2)
    return landmarks.ids[chosen], mask[chosen]


def _move_map(
    local_map: LocalMap, T_odom_cam: Array, covariance: list[Array], ids: Indices,
    points_odom: Array, information: Array,
) -> LocalMap:  # fmt: skip
    """Replace poses (K, 4, 4), covariances (6, 6), and the points (J, 3) of adjusted landmarks.

    Their information (J, 3, 3) tells how well they are known along their spread. The other
    landmarks move with their anchors.
    """
    keyframes, landmarks = local_map.keyframes, local_map.landmarks
    moved = T_odom_cam @ se3.inverse(np.stack([k.T_odom_cam for k in keyframes]))
    anchor = landmarks.anchor - keyframes[0].serial
    points = np.einsum("nij,nj->ni", moved[anchor, :3, :3], landmarks.points_odom)
    points += moved[anchor, :3, 3]
    rows, spread = np.searchsorted(landmarks.ids, ids), landmarks.spread_odom.copy()
    points[rows] = points_odom
    known = np.einsum("ni,nij,nj->n", spread[rows], information, spread[rows])
    spread[rows] /= np.sqrt(np.maximum(known, UNKNOWN))[:, None]
    keyframes = tuple(
        replace(k, T_odom_cam=T, covariance=C)
        for k, T, C in zip(keyframes, T_odom_cam, covariance, strict=True)
    )
    landmarks = replace(landmarks, points_odom=points, spread_odom=spread)
    return replace(local_map, keyframes=keyframes, landmarks=landmarks)


def _learn_noise(local_map: LocalMap, misfits: Array, settings: RefinementSettings) -> LocalMap:
    """Adapt the noise to (2,) misfits of pixels and disparities, slowly and within limits."""
    if not settings.learn_noise:
        return local_map
    factor = np.where(np.isfinite(misfits), np.maximum(misfits, 1e-3), 1.0) ** (LEARNING_RATE / 2)
    pixels, disparities = np.clip(np.array(local_map.noise) * factor, 0.5, 10.0)
    return replace(local_map, noise=(float(pixels), float(disparities)))


class IncrementalAdjustment:
    """Bundle adjustment by a fixed-lag smoother, keyframe by keyframe.

    The smoother starts anew at the last two keyframes where it fails, and where the map is no
    longer the one that it left: after a loss, a map reset or a merge.
    """

    def __init__(self, rig: StereoRig, settings: RefinementSettings) -> None:
        from vo.bundle_adjustment import fixed_lag  # loads gtsam

        self._rig, self._settings, self._new = rig, settings, fixed_lag.FixedLag
        self._smoother: FixedLag | None = None
        self._T_odom_cam: dict[int, Array] = {}

    def __call__(self, local_map: LocalMap) -> tuple[LocalMap, int]:
        """Add the newest keyframe; return the adjusted map and the iterations."""
        s = self._settings
        smoother, self._smoother = self._smoother if self._continues(local_map) else None, None
        first = smoother.first if smoother else local_map.keyframes[-2:][0].serial
        keyframes = tuple(k for k in local_map.keyframes if k.serial >= first)
        ids, mask = _select_landmarks(local_map, keyframes, s)
        if smoother:
            unspent = ~np.isin(ids, smoother.spent)
            ids, mask = ids[unspent], mask[unspent]
        if len(keyframes) < 2 or mask[:, -1].sum() < MIN_POINTS:
            return local_map, 0
        oldest = keyframes[0]
        smoother = smoother or self._new(first, oldest.T_odom_cam, oldest.covariance, s.window)
        points = local_map.landmarks.points_odom[np.searchsorted(local_map.landmarks.ids, ids)]
        poses = {k.serial: k.T_odom_cam for k in keyframes}
        seen = {k.serial: k.observations for k in keyframes}
        try:
            found = smoother.update(poses, seen, ids, points, self._rig, s)
        except RuntimeError:  # gtsam's IndeterminateLinearSystemException has no type of its own
            return local_map, s.max_iterations
        unmoved = local_map.keyframes[: -len(keyframes)]
        T = [k.T_odom_cam for k in unmoved] + list(found.T_odom_cam)
        covariance = [k.covariance for k in unmoved] + list(found.covariance)
        x = found.estimates
        points = x.points, x.information(found.T_odom_cam[x.cameras])
        moved = _move_map(local_map, np.array(T), covariance, found.ids, *points)
        self._smoother = smoother
        self._T_odom_cam = {k.serial: k.T_odom_cam for k in moved.keyframes}
        noise = misfit(found.estimates, found.T_odom_cam)
        return _learn_noise(moved, noise, s), found.iterations

    def _continues(self, local_map: LocalMap) -> bool:
        """Whether the map's older keyframes are where the smoother left them."""
        older, known = local_map.keyframes[:-1], self._T_odom_cam
        return bool(older) and all(
            k.serial in known and np.array_equal(k.T_odom_cam, known[k.serial]) for k in older
        )
