"""Cameras, points and what the cameras measured; cut into chunks that share few cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vo.bundle_adjustment.robust_covariance import shares
from vo.bundle_adjustment.schur import all_residuals, reduce, robust_weights
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig

WHOLE = 24
"""Bundles of no more cameras are one chunk: dense equations of this size are cheap."""

SPAN = 6
"""Points first seen by so many cameras in a row are a chunk of a larger bundle."""

DETERMINED = 6
"""A camera that sees fewer points is not placed by them."""


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


@dataclass(frozen=True)
class Sight:
    """What one camera saw.

    Attributes:
        T_world_cam: (4, 4).
        ids: (N,) landmarks, ascending.
        measured: (N, 3) left-image u, v and disparity, pixels; NaN where not measured.
        sigma: (N, 3) their standard deviations.
    """

    T_world_cam: Array
    ids: Indices
    measured: Array
    sigma: Array


def collect(
    sights: Sequence[Sight], ids: Indices, points_world: Array, fixed: Mask, rig: StereoRig
) -> Bundle:
    """Make a bundle of those landmarks (J,), ascending, that lie at points (J, 3)."""
    used = [np.isin(sight.ids, ids) for sight in sights]
    pairs = list(zip(sights, used, strict=True))
    return Bundle(
        T_world_cam=np.stack([sight.T_world_cam for sight in sights]),
        points_world=points_world,
        camera=np.concatenate([np.full(u.sum(), i) for i, u in enumerate(used)]),
        point=np.concatenate([np.searchsorted(ids, s.ids[u]) for s, u in pairs]),
        measured=np.concatenate([s.measured[u] for s, u in pairs]).astype(np.float64),
        sigma=np.concatenate([s.sigma[u] for s, u in pairs]).astype(np.float64),
        fixed=fixed,
        K=rig.K,
        baseline_m=rig.baseline_m,
    )


@dataclass
class Chunk:
    """Some points of a bundle, which follow the cameras wherever these are put.

    Attributes:
        rows: (P,) of the bundle's points.
        cameras: (C,) of the bundle's cameras, those that see one of the points.
        points: (P, 3) where they were last found.
        first: (P + 1,) where the measurements of each point begin.
        camera: (M,) index among `cameras`.
        measured: (M, 3) u, v, disparity; anything where the weight is zero.
        known: (M, 3) one over sigma; zero where nothing was measured.
        weight: (M, 3) the same, less for outliers.
        intrinsics: fx, fy, cx, cy, and focal length times baseline.
    """

    rows: Indices
    cameras: Indices
    points: Array
    first: Indices
    camera: Indices
    measured: Array
    known: Array
    weight: Array
    intrinsics: Array

    def normal(self, T: Array, moving: Mask, derivatives: bool) -> tuple[Array, Array, float]:
        """Solve for the points and eliminate them.

        Args:
            T: (C, 4, 4) cameras.
            moving: (C,) those whose normal equations are wanted.
            derivatives: Whether they are; otherwise the cost alone.

        Returns:
            Information, gradient and cost as `vo.bundle_adjustment.solver.Normal` has them.
        """
        size = int(moving.sum()) if derivatives else 0
        slot = np.where(moving, np.cumsum(moving) - 1, -1) if derivatives else np.full(len(T), -1)
        H, g, cost, self.points = reduce(
            *split_pose(T), self.points, self.first, self.camera, self.measured, self.weight,
            self.intrinsics, slot, size,
        )  # fmt: skip
        return H, g, cost

    def shares(self, T: Array, moving: Mask) -> Array:
        """What the points' residuals do to the gradient, as `robust_covariance.shares` says."""
        slot = np.where(moving, np.cumsum(moving) - 1, -1)
        return shares(
            *split_pose(T), self.points, self.first, self.camera, self.measured, self.weight,
            self.intrinsics, slot, int(moving.sum()),
        )  # fmt: skip

    def reweigh(self, T: Array, huber: float) -> None:
        """Take the Huber weights of the present residuals."""
        self.weight = robust_weights(
            *split_pose(T), self.points, self.camera, self._point, self.measured, self.known,
            self.intrinsics, huber,
        )  # fmt: skip

    def residuals(self, T: Array) -> Array:
        """Residuals (M, 3) in sigmas, zero where nothing was measured."""
        return all_residuals(
            *split_pose(T), self.points, self.camera, self._point, self.measured, self.known,
            self.intrinsics,
        )  # fmt: skip

    @property
    def _point(self) -> Indices:
        return np.repeat(np.arange(len(self.points)), np.diff(self.first))


def chunks(bundle: Bundle, use_disparity: bool = True) -> list[Chunk]:
    """Cut a bundle into groups of points that were first seen at about the same time."""
    K, J = len(bundle.T_world_cam), len(bundle.points_world)
    first_seen = np.full(J, K)
    np.minimum.at(first_seen, bundle.point, bundle.camera)
    group = np.zeros(J, dtype=np.int64) if K <= WHOLE else first_seen // SPAN
    order = np.argsort(bundle.point, kind="stable")
    measured, known = weigh(bundle.measured, bundle.sigma, use_disparity)
    f = intrinsics(bundle.K, bundle.baseline_m)
    made: list[Chunk] = []
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        own = order[group[bundle.point[order]] == g]
        cameras, camera = np.unique(bundle.camera[own], return_inverse=True)
        point = np.searchsorted(rows, bundle.point[own])
        first = np.searchsorted(point, np.arange(len(rows) + 1))
        made.append(
            Chunk(
                rows=rows,
                cameras=cameras,
                points=bundle.points_world[rows].astype(np.float64),
                first=first,
                camera=camera,
                measured=measured[own],
                known=known[own],
                weight=known[own],
                intrinsics=f,
            )
        )
    return made


def weigh(measured: Array, sigma: Array, use_disparity: bool) -> tuple[Array, Array]:
    """Measurements without NaN, and one over their sigmas, zero where nothing was measured."""
    weight = np.where(np.isnan(measured), 0.0, 1.0 / sigma)
    if not use_disparity:
        weight[:, 2] = 0.0
    return np.nan_to_num(measured), weight


def intrinsics(K: Array, baseline_m: float) -> Array:
    """fx, fy, cx, cy, and focal length times baseline: (5,)."""
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 0] * baseline_m])


def split_pose(T: Array) -> tuple[Array, Array]:
    """Rotations (K, 3, 3) and positions (K, 3) of poses (K, 4, 4)."""
    return np.ascontiguousarray(T[:, :3, :3]), np.ascontiguousarray(T[:, :3, 3])
