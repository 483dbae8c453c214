"""Looking back at the end: the last word on every keyframe, or one bundle of all (thesis 4.2)."""

from dataclasses import replace

import numpy as np

from vo.bundle_adjustment.adjust import refine_structure
from vo.bundle_adjustment.problem import MIN_POINTS, Sight, collect
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Indices
from vo.contract.estimator import FinalResult
from vo.contract.rig import StereoRig
from vo.map.run_history import History


def look_back(history: History, rig: StereoRig, settings: RefinementSettings) -> FinalResult:
    """The smoothed trajectory, if one is wanted, and the map that belongs to it."""
    if settings.smooth == "none":
        return FinalResult(None, history.points)
    if settings.smooth == "global":
        history = refine_all(history, rig, settings)
    return FinalResult(history.smoothed, history.points)


def refine_all(history: History, rig: StereoRig, settings: RefinementSettings) -> History:
    """Refine all keyframes and all landmarks of a run together.

    Where a keyframe shares too few landmarks with those before, a new group begins: it hangs
    rigidly on the keyframe before its first one, as it did along the way.

    Args:
        history: With the sights of all keyframes; stays as it is.
        rig: Projects.
        settings: Which landmarks take part, loss and iterations.
    """
    serials = sorted(history.sights)
    if not serials:
        return history
    sights = [replace(history.sights[s], T_world_cam=history.keyframes[s]) for s in serials]
    ids = _repeated(sights, np.array(sorted(history.places), dtype=np.int64))
    keyframes, places = dict(history.keyframes), dict(history.places)
    hung = np.eye(4)
    for group in _groups(sights, ids):
        members = [sights[i] for i in group]
        shared = _repeated(members, ids)
        T_before = np.stack([sight.T_world_cam for sight in members])
        T_after = hung @ T_before
        if len(group) > 1:
            fixed = np.arange(len(group)) == 0
            bundle = collect(members, shared, history.positions(shared), fixed, rig)
            refined = refine_structure(bundle, settings, covariances=False)
            T_after = hung @ refined.T_world_cam
            found = se3.transform(hung, refined.points_world)
            places |= dict(zip(shared.tolist(), found, strict=True))
        keyframes |= {serials[i]: T_after[k] for k, i in enumerate(group)}
        hung = T_after[-1] @ se3.inverse(T_before[-1])
    return replace(history, keyframes=keyframes, places=places)


def _repeated(sights: list[Sight], ids: Indices) -> Indices:
    """Those of the landmarks that two sights have in common, ascending."""
    seen, times = np.unique(np.concatenate([s.ids for s in sights]), return_counts=True)
    return np.intersect1d(seen[times >= 2], ids)


def _groups(sights: list[Sight], ids: Indices) -> list[list[int]]:
    """Sights in order of time, cut where one shares too few of the landmarks with its group."""
    groups: list[list[int]] = []
    seen = np.zeros(0, np.int64)
    for i, sight in enumerate(sights):
        own = np.intersect1d(sight.ids, ids)
        if not groups or np.isin(own, seen).sum() < MIN_POINTS:
            groups.append([])
            seen = own
        groups[-1].append(i)
        seen = np.union1d(seen, own)
    return groups
