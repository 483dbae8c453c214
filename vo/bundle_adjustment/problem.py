"""Bundles of cameras, points and measurements; cut into blocks of points that few cameras see."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vo.bundle_adjustment.schur import Cameras, Measurements
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig

DENSE_CAMERAS = 24
"""Largest bundle that is a single block: dense equations of this size are cheap."""

BLOCK_CAMERAS = 6
"""In a larger bundle, points first seen by this many successive cameras form a block."""

MIN_POINTS = 6
"""A camera that sees fewer points is not determined by them."""


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
    used = [np.isin(seen.ids, ids) for seen in observations]
    pairs = list(zip(observations, used, strict=True))
    return Bundle(
        T_world_cam=T_world_cam,
        points_world=points_world,
        camera=np.concatenate([np.full(u.sum(), i) for i, u in enumerate(used)]),
        point=np.concatenate([np.searchsorted(ids, seen.ids[u]) for seen, u in pairs]),
        measured=np.concatenate([seen.measured[u] for seen, u in pairs]).astype(np.float64),
        sigma=np.concatenate([seen.sigma_px[u] for seen, u in pairs]).astype(np.float64),
        fixed=fixed,
        K=rig.K,
        baseline_m=rig.baseline_m,
    )


@dataclass(frozen=True)
class PointBlock:
    """Some points (P, 3) of a bundle, by their rows (P,) in it, with all of their measurements.

    The cameras (C,) are those that see one of the points; the measurements index them.
    """

    rows: Indices
    cameras: Indices
    points: Array
    data: Measurements


def point_blocks(bundle: Bundle, use_disparity: bool = True) -> list[PointBlock]:
    """Cut a bundle into groups of points that were first seen at about the same time."""
    K, J = len(bundle.T_world_cam), len(bundle.points_world)
    first_seen = np.full(J, K)
    np.minimum.at(first_seen, bundle.point, bundle.camera)
    group = np.zeros(J, dtype=np.int64) if K <= DENSE_CAMERAS else first_seen // BLOCK_CAMERAS
    order = np.argsort(bundle.point, kind="stable")
    measured, weight = weigh(bundle.measured, bundle.sigma, use_disparity)
    f = intrinsics(bundle.K, bundle.baseline_m)
    blocks: list[PointBlock] = []
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        own = order[group[bundle.point[order]] == g]
        cameras, camera = np.unique(bundle.camera[own], return_inverse=True)
        point = np.searchsorted(rows, bundle.point[own])
        first = np.searchsorted(point, np.arange(len(rows) + 1))
        data = Measurements(first, camera, measured[own], weight[own], f)
        blocks.append(PointBlock(rows, cameras, bundle.points_world[rows].astype(np.float64), data))
    return blocks


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
