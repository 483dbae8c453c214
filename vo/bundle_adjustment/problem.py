"""Bundles of cameras, points and measurements."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vo.bundle_adjustment.schur import Cameras, Measurements
from vo.contract.arrays import Array, Indices, Mask, find_sorted
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig

MIN_POINTS = 6
"""A camera that sees fewer points is not determined by them."""

TURN_LAST = [3, 4, 5, 0, 1, 2]
"""From the tangents (w, v) of normal equations to (v, w)."""


@dataclass(frozen=True)
class Bundle:
    """Cameras, points and measurements.

    Attributes:
        T_world_cam: (K, 4, 4) initial poses, in order of time.
        points_world: (J, 3) initial points, metres.
        camera: (M,) index of the camera of each measurement.
        point: (M,) index of the point of each measurement.
        measured: (M, 3) left-image u, v and disparity, pixels; NaN where not measured.
        sigma: (M, 3) their standard deviations, pixels.
        fixed: (K,) cameras that must not move; at least one.
        K: (3, 3) pinhole matrix without skew.
        baseline_m: Of the stereo pair.
    """

    T_world_cam: Array
    points_world: Array
    camera: Indices
    point: Indices
    measured: Array
    sigma: Array
    fixed: Mask
    K: Array
    baseline_m: float


class Optimum(NamedTuple):
    """Solution of a bundle by one of the optimisers.

    Attributes:
        T_world_cam: (K, 4, 4).
        information: (6 S, 6 S) of the S cameras that may move, by tangents (w, v); anything if it
            was not asked for.
        error: Half the sum of the robust squared residuals, in sigmas.
        iterations: Levenberg-Marquardt steps.
    """

    T_world_cam: Array
    information: Array
    error: float
    iterations: int


def collect(
    T_world_cam: Array,
    observations: Sequence[Observations],
    ids: Indices,
    points_world: Array,
    fixed: Mask,
    rig: StereoRig,
) -> Bundle:
    """Make a bundle of some landmarks (J,), ascending, and of the cameras that observe them.

    The arguments are as in `Bundle`; observations are those of each camera, ids ascending.
    """
    counts = [len(seen) for seen in observations]
    measured = np.concatenate([x.at_instant for x in observations])
    sigma = np.concatenate([x.sigma_px for x in observations])
    place = np.concatenate([find_sorted(ids, x.ids) for x in observations])
    used = place >= 0
    return Bundle(
        T_world_cam=T_world_cam,
        points_world=points_world,
        camera=np.repeat(np.arange(len(counts)), counts)[used],
        point=place[used],
        measured=measured[used].astype(np.float64),
        sigma=sigma[used].astype(np.float64),
        fixed=fixed,
        K=rig.K,
        baseline_m=rig.baseline_m,
    )


def sorted_measurements(bundle: Bundle, use_disparity: bool = True) -> tuple[Indices, Measurements]:
    """Sort the measurements of a bundle by point; they index the cameras (C,) that see any."""
    order = np.argsort(bundle.point, kind="stable")
    measured, weight = weigh(bundle.measured, bundle.sigma, use_disparity)
    seeing = np.bincount(bundle.camera, minlength=len(bundle.T_world_cam)) > 0
    cameras, camera = np.flatnonzero(seeing), (np.cumsum(seeing) - 1)[bundle.camera[order]]
    first = np.searchsorted(bundle.point[order], np.arange(len(bundle.points_world) + 1))
    f = intrinsics(bundle.K, bundle.baseline_m)
    return cameras, Measurements(first, camera, measured[order], weight[order], f)


def weigh(measured: Array, sigma: Array, use_disparity: bool) -> tuple[Array, Array]:
    """Return (N, 3) measurements without NaN, and one over sigma, zero where not measured."""
    weight = np.where(np.isnan(measured), 0.0, 1.0 / sigma)
    if not use_disparity:
        weight[:, 2] = 0.0
    return np.nan_to_num(measured), weight


def intrinsics(K: Array, baseline_m: float) -> Array:
    """Return fx, fy, cx, cy, and focal length times baseline: (5,)."""
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 0] * baseline_m])


def as_cameras(T: Array) -> Cameras:
    """Split poses (K, 4, 4) into rotations and centres."""
    return Cameras(np.ascontiguousarray(T[:, :3, :3]), np.ascontiguousarray(T[:, :3, 3]))
