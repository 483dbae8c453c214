"""A stereo camera that drives past points, which come and go: keyframes with known noise."""

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from vo.bundle_adjustment.problem import collect
from vo.contract import se3
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.map.local_map import Keyframe, empty_map

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
SIGMA = np.array([0.2, 0.2, 0.3])
BLANK = np.zeros((480, 640), np.uint8)
STEP = se3.exp(np.array([0.03, 0.0, 0.12, 0.0, 0.03, 0.003]))


class Passage:
    """Cameras a step apart in the first one's frame; points are sown as they advance."""

    def __init__(self, seed, keyframes, fresh=25, step=STEP, sigma=SIGMA):
        rng = np.random.default_rng(seed)
        self.T_odom_cam = np.array([np.linalg.matrix_power(step, i) for i in range(keyframes)])
        points = []
        for T in self.T_odom_cam:
            pixels = rng.uniform([20, 20], [620, 460], (fresh, 2))
            depth_m = rng.uniform(1.5, 4, fresh)
            seen = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / depth_m)
            points.append(se3.transform(T, seen))
        self.points = np.concatenate(points)
        self.keyframes = []
        for i, T in enumerate(self.T_odom_cam):
            exact = RIG.project(se3.transform(se3.inverse(T), self.points))
            inside = (exact[:, 2] > 3) & (exact[:, 2] < 60) & (exact[:, :2] > 0).all(axis=1)
            inside &= (exact[:, :2] < [639, 479]).all(axis=1)
            inside &= np.arange(len(self.points)) < (i + 1) * fresh
            (ids,) = np.nonzero(inside)
            measured = exact[ids] + rng.normal(scale=sigma, size=(len(ids), 3))
            sigma_px = np.tile(SIGMA, (len(ids), 1))
            seen = Observations(ids, measured[:, :2], measured[:, 2], sigma_px=sigma_px)
            self.keyframes.append(Keyframe(BLANK, seen, i, T, np.zeros((6, 6))))

    def started(self, rng, error=0.01):
        """The same, from poses that are off by a centimetre or so, but for the first."""
        off = se3.exp(rng.normal(scale=error, size=(len(self.keyframes), 6)))
        off[0] = np.eye(4)
        return [
            replace(k, T_odom_cam=k.T_odom_cam @ e)
            for k, e in zip(self.keyframes, off, strict=True)
        ]

    def local_map(self, keyframes):
        """The map of a window: points where the first keyframe that measured them puts them."""
        landmarks = empty_map().landmarks
        ids = np.unique(np.concatenate([k.observations.ids for k in keyframes]))
        points, views, anchor = (
            np.zeros((len(ids), 3)),
            np.zeros(len(ids), int),
            np.zeros(len(ids), int),
        )
        for i, k in enumerate(keyframes):
            rows = np.searchsorted(ids, k.observations.ids)
            seen = RIG.triangulate(k.observations.pixels, k.observations.disparity_px)
            new = views[rows] == 0
            points[rows[new]] = se3.transform(k.T_odom_cam, seen)[new]
            anchor[rows[new]] = i
            views[rows] += 1
        n = len(ids)
        landmarks = replace(
            landmarks,
            ids=ids,
            points_odom=points,
            spread_odom=np.zeros((n, 3)),
            views=views,
            anchor=anchor,
            descriptors=np.zeros((n, 1), np.float32),
            anchor_pixels=np.zeros((n, 2)),
            anchor_depth_m=np.ones(n),
            anchor_slopes=np.zeros((n, 2)),
        )
        start = empty_map(len(keyframes), int(ids[-1]) + 1)
        return replace(start, keyframes=tuple(keyframes), landmarks=landmarks, first_serial=0)


def collected(keyframes, ids, points, fixed):
    """The bundle of some keyframes."""
    T = np.stack([k.T_odom_cam for k in keyframes])
    return collect(T, [k.observations for k in keyframes], ids, points, fixed, RIG)


def gtsam_bundle(bundle):
    """GTSAM's own stereo factors on all poses and points: poses (K, 4, 4), points, covariances."""
    f, cx, cy = bundle.K[0, 0], bundle.K[0, 2], bundle.K[1, 2]
    calibration = gtsam.Cal3_S2Stereo(f, f, 0.0, cx, cy, bundle.baseline_m)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, T in enumerate(bundle.T_world_cam):
        values.insert(X(i), gtsam.Pose3(T))
        if bundle.fixed[i]:
            graph.add(gtsam.NonlinearEqualityPose3(X(i), gtsam.Pose3(T)))
    for j, point in enumerate(bundle.points_world):
        values.insert(L(j), point)
    to_stereo = np.array([[1, 0, 0], [1, 0, -1], [0, 1, 0]])  # u, v, disparity to u, u_right, v
    for i, j, m, s in zip(bundle.camera, bundle.point, bundle.measured, bundle.sigma, strict=True):
        noise = gtsam.noiseModel.Gaussian.Covariance(to_stereo @ np.diag(s**2) @ to_stereo.T)
        pixel = gtsam.StereoPoint2(*(to_stereo @ m))
        graph.add(gtsam.GenericStereoFactor3D(pixel, noise, X(i), L(j), calibration))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    parameters.setMaxIterations(100)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    marginals = gtsam.Marginals(graph, found)
    turn = [3, 4, 5, 0, 1, 2]
    covariances = [
        marginals.marginalCovariance(X(i))[turn][:, turn] for i in range(len(bundle.fixed))
    ]
    poses = [found.atPose3(X(i)).matrix() for i in range(len(bundle.fixed))]
    points = [found.atPoint3(L(j)) for j in range(len(bundle.points_world))]
    return np.array(poses), np.array(points), np.array(covariances)
