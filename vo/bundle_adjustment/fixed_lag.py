"""Incremental adjustment of the last keyframes, with older ones marginalised into a prior.

iSAM2 (Kaess et al., IJRR 2012) on the keyframes' poses alone, inside GTSAM's fixed-lag smoother.
Points are eliminated from its factors as in the window (`vo.bundle_adjustment.schur`). When a
keyframe leaves, the points that it observed and that the newest one does not are marginalised:
their measurements become a factor that leaves with it. Of points that are still observed, its
measurement is dropped, as by Leutenegger et al. (OKVIS, IJRR 2015, section 4.3): a prior on them
would couple all of them. Where that leaves too few, the oldest of these are marginalised too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.bundle_adjustment.problem import TURN_LAST, collect
from vo.bundle_adjustment.solver import factor
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig

RELINEARIZATION_STEP = 1e-6
"""Step, in metres or radians, beyond which a pose is linearised anew."""

GAUGE_SIGMA = 1e-6
"""Standard deviation of the first keyframe's pose, metres and radians."""

CONVERGED = 1e-5
"""Change of all poses, metres and radians, that ends the steps of an update."""

MIN_MARGINALIZED = 30
"""Points to marginalise with a keyframe at least, for the later ones to stay determined."""


@dataclass(frozen=True)
class Smoothed:
    """Keyframes (K, 4, 4) in the lag after an update, with covariances (K, 6, 6) of (v m, w rad).

    The estimates are those of the landmarks (J,) that took part, after Gauss-Newton iterations.
    """

    T_odom_cam: Array
    covariance: Array
    ids: Indices
    estimates: PointEstimates
    iterations: int


class FixedLag:
    """Keyframes in the lag, and a prior from those before, since a first one; one segment's.

    The measurements of `spent` landmarks are in the prior already, and must not come again.
    """

    def __init__(self, first: int, T_odom_first: Array, covariance: Array, lag: int) -> None:
        """Start with one keyframe, whose pose (4, 4) holds the gauge; `lag` keyframes are kept.

        Its covariance (6, 6), tangent (v m, w rad), is handed on to all others.
        """
        self.first, self._T_odom_first, self._covariance = first, T_odom_first, covariance
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZATION_STEP)
        parameters.relinearizeSkip = 1
        self._smoother = gtsam.IncrementalFixedLagSmoother(lag - 1.0, parameters)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        gauge = gtsam.noiseModel.Isotropic.Sigma(6, GAUGE_SIGMA)
        start = gtsam.Pose3(T_odom_first)
        graph.add(gtsam.PriorFactorPose3(X(first), start, gauge))
        values.insert(X(first), start)
        self._smoother.update(graph, values, {X(first): float(first)})
        self._active: list[int] = []
        self._T_odom_cam: Mapping[int, Array] = {}
        self._observations: Mapping[int, Observations] = {}
        self._landmarks: tuple[Indices, Array] = np.zeros(0, np.int64), np.zeros((0, 3))
        self.spent = np.zeros(0, np.int64)

    def update(
        self,
        T_odom_cam: Mapping[int, Array],
        observations: Mapping[int, Observations],
        ids: Indices,
        points_odom: Array,
        rig: StereoRig,
        settings: RefinementSettings,
    ) -> Smoothed:
        """Take in keyframes, and replace the factor of the landmarks in sight.

        The keyframes are those in the lag by serial, ascending, the newest ones new. The landmarks
        to use (J,), ascending, at about (J, 3) metres, are each in two of them at least; those that
        are spent, or become so now, are left out.

        Raises:
            RuntimeError: If nothing determines a pose; the smoother is of no use any more.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        times: dict[Any, float] = {}
        for serial, T in T_odom_cam.items():
            if serial not in self._observations and serial != self.first:
                values.insert(X(serial), gtsam.Pose3(T))
                times[X(serial)] = float(serial)
        serials = list(T_odom_cam)
        in_sight = observations[serials[-1]].ids
        if marginalized := self._marginalize(serials[0], in_sight, rig, settings):
            graph.add(marginalized)
        fresh = ~np.isin(ids, self.spent)
        ids, points_odom = ids[fresh], points_odom[fresh]
        active = _estimates(T_odom_cam, observations, ids, points_odom, rig, settings)
        graph.add(_factor(serials, active))
        self._smoother.update(graph, values, times, self._active)
        self._active = [self._smoother.getISAM2Result().getNewFactorsIndices()[-1]]
        self._T_odom_cam, self._observations = T_odom_cam, observations
        self._landmarks = ids, points_odom
        return self._converge(serials, ids, active, settings)

    def _marginalize(
        self, kept: int, in_sight: Indices, rig: StereoRig, settings: RefinementSettings
    ) -> gtsam.CustomFactor | None:
        """Landmarks of keyframes that leave now: out of sight, or the oldest."""
        leaving = [x.ids for serial, x in self._observations.items() if serial < kept]
        ids, points = self._landmarks
        if not leaving:
            return None
        theirs = np.isin(ids, np.concatenate(leaving))
        used = theirs & ~np.isin(ids, in_sight)
        lasting = np.flatnonzero(theirs & ~used)
        used[lasting[: max(0, MIN_MARGINALIZED - int(used.sum()))]] = True
        if not used.any():
            return None
        self.spent = np.concatenate([self.spent, ids[used]])
        recent = np.unique(np.concatenate([x.ids for x in self._observations.values()]))
        self.spent = self.spent[np.isin(self.spent, recent)]
        known = self._T_odom_cam, self._observations
        estimates = _estimates(*known, ids[used], points[used], rig, settings)
        return _factor(list(self._T_odom_cam), estimates)

    def _converge(
        self, serials: list[int], ids: Indices, active: PointEstimates, s: RefinementSettings
    ) -> Smoothed:
        """Take Gauss-Newton steps until they are small."""
        T_odom_cam, steps = self._poses(serials), 1
        while steps < s.max_iterations:
            self._smoother.update()
            T_before, T_odom_cam = T_odom_cam, self._poses(serials)
            steps += 1
            if np.abs(se3.log(se3.inverse(T_before) @ T_odom_cam)).max() < CONVERGED:
                break
        cameras = active.cameras
        active.linearize(T_odom_cam[cameras], np.zeros(len(cameras), bool), derivatives=False)
        marginals = [self._smoother.marginalCovariance(X(serial)) for serial in serials]
        covariance = np.array(marginals)[:, TURN_LAST][:, :, TURN_LAST]
        T_cam_first = se3.inverse(T_odom_cam) @ self._T_odom_first  # hands its covariance on
        covariance += [se3.transform_covariance(T, self._covariance) for T in T_cam_first]
        return Smoothed(T_odom_cam, covariance, ids, active, steps)

    def _poses(self, serials: list[int]) -> Array:
        estimate = self._smoother.calculateEstimate()
        return np.array([estimate.atPose3(X(serial)).matrix() for serial in serials])


def _estimates(
    T_odom_cam: Mapping[int, Array], observations: Mapping[int, Observations], ids: Indices,
    points: Array, rig: StereoRig, s: RefinementSettings,
) -> PointEstimates:  # fmt: skip
    poses, free = np.stack(list(T_odom_cam.values())), np.zeros(len(T_odom_cam), bool)
    bundle = collect(poses, list(observations.values()), ids, points, free, rig)
    estimates = PointEstimates(bundle, s.use_disparity)
    estimates.reweight(bundle.T_world_cam[estimates.cameras], s.huber)
    return estimates


def _factor(serials: list[int], estimates: PointEstimates) -> gtsam.CustomFactor:
    cameras = estimates.cameras
    moving = np.ones(len(cameras), bool)

    def linearize(poses: Array, derivatives: bool) -> tuple[Array, Array, float]:
        return estimates.linearize(poses, moving, derivatives)

    return factor([X(serials[i]) for i in cameras], linearize)
