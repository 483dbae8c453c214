"""Smoothing of a run after its last frame by full-batch bundle adjustment (thesis 4.2)."""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import refine_structure
from vo.bundle_adjustment.problem import MIN_POINTS, collect
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Indices
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.map.run_history import RunHistory


def smooth(history: RunHistory, rig: StereoRig, settings: RefinementSettings) -> RunHistory:
    """Adjust all keyframes and all landmarks of a run together, by GTSAM's factors.

    Where a keyframe shares too few landmarks with those before, a new group begins: it stays rigid
    with the last keyframe before it, as it was along the way.
    """
    serials = sorted(s for s, k in history.keyframes.items() if k.observations is not None)
    if not serials:
        return history
    settings = settings.model_copy(update={"backend": "gtsam"})
    seen = [x for s in serials if (x := history.keyframes[s].observations) is not None]
    T_before_all = [history.keyframes[s].T_odom_cam for s in serials]
    ids = _repeated(seen, history.ids)
    keyframes, points = dict(history.keyframes), history.points.copy()
    T_new_old = np.eye(4)
    for group in _groups(seen, ids):
        members = [seen[i] for i in group]
        shared = _repeated(members, ids)
        T_before = np.stack([T_before_all[i] for i in group])
        T_after = T_new_old @ T_before
        if len(group) > 1:
            fixed = np.arange(len(group)) == 0
            bundle = collect(T_before, members, shared, history.positions(shared), fixed, rig)
            refined = refine_structure(bundle, settings, covariances=False)
            T_after = T_new_old @ refined.T_world_cam
            points[shared] = se3.transform(T_new_old, refined.points_world)
        for i, T in zip(group, T_after, strict=True):
            keyframes[serials[i]] = keyframes[serials[i]]._replace(T_odom_cam=T)
        T_new_old = T_after[-1] @ se3.inverse(T_before[-1])
    return replace(history, keyframes=keyframes, points=points)


def _repeated(seen: list[Observations], ids: Indices) -> Indices:
    """Those of the landmarks that two keyframes have in common, ascending."""
    known, times = np.unique(np.concatenate([x.ids for x in seen]), return_counts=True)
    return np.intersect1d(known[times >= 2], ids)


def _groups(seen: list[Observations], ids: Indices) -> list[list[int]]:
    """Keyframes in order of time, cut where one shares too few of the landmarks with its group."""
    groups: list[list[int]] = []
    shared = np.zeros(0, np.int64)
    for i, observations in enumerate(seen):
        own = np.intersect1d(observations.ids, ids)
        if not groups or np.isin(own, shared).sum() < MIN_POINTS:
            groups.append([])
            shared = own
        groups[-1].append(i)
        shared = np.union1d(shared, own)
    return groups
