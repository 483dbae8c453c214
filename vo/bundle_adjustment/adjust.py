"""Bundle adjustment: motion only, or motion and structure (thesis 2.8, 3.4).

All measurements of a bundle are few factors on its cameras, from which
`vo.bundle_adjustment.schur` has eliminated the points: GTSAM then solves for the cameras alone, and
Python is entered once an iteration and factor instead of once a measurement (docs/decisions/0006).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vo.bundle_adjustment.problem import Bundle, Chunk, chunks, intrinsics, split_pose, weigh
from vo.bundle_adjustment.robust_covariance import camera_shares
from vo.bundle_adjustment.schur import camera_normal, robust_weights
from vo.bundle_adjustment.solver import TURN_LAST, Part, information_inverse, optimize
from vo.config import RefinementSettings
from vo.contract.arrays import Array, Mask
from vo.contract.rig import StereoRig

REWEIGHTINGS = 3
"""Rounds in which the Huber weights are renewed (Holland and Welsch, 1977), for one camera."""

SIX = np.arange(6)

MEDIAN_CHI2 = (0.455, 1.386)
"""Medians of chi-squared with one and two degrees of freedom."""


@dataclass(frozen=True)
class Refined:
    """A bundle's solution.

    Attributes:
        T_world_cam: (K, 4, 4).
        points_world: (J, 3) metres.
        covariance: (K, 6, 6) of each camera given the fixed ones, tangent (v m, w rad) in its own
            frame; zero for those, and for all if it was not asked for.
        iterations: Levenberg–Marquardt steps; `max_iterations` if it did not converge.
        error: Final value of half the summed robust squared whitened residuals.
        misfit: (2,) median squared residual of pixels and of disparities, over what their sigmas
            make one expect; 1 where they are right, NaN where there are none.
    """

    T_world_cam: Array
    points_world: Array
    covariance: Array
    iterations: int
    error: float
    misfit: Array


@dataclass(frozen=True)
class Pose:
    """A camera refined on points that stay.

    Attributes:
        T_world_cam: (4, 4).
        covariance: (6, 6) tangent (v m, w rad) in the camera's frame; of the measurements alone.
        iterations: Levenberg–Marquardt steps.
    """

    T_world_cam: Array
    covariance: Array
    iterations: int


def refine_structure(
    bundle: Bundle, settings: RefinementSettings, covariances: bool = True
) -> Refined:
    """Minimise the reprojection error over all cameras that may move and all points.

    Every point should be seen by at least three cameras (thesis 4.4); this function takes what
    it is given. The covariances of K cameras cost K cubed.

    Source:
        thesis eq. 2.29 with a Huber loss; the gauge is held by the fixed cameras.
    """
    pieces = chunks(bundle, settings.use_disparity)
    T = bundle.T_world_cam.copy()
    moving = ~bundle.fixed
    parts = [_part(chunk, T, moving) for chunk in pieces if moving[chunk.cameras].any()]
    iterations = 0
    most = settings.max_iterations
    for steps_left in (1, most - 1)[:most]:  # Huber's weights follow the first step
        for chunk in pieces:
            chunk.reweigh(T[chunk.cameras], settings.huber)
        T[moving], steps = optimize(T[moving], parts, steps_left)
        iterations += steps
    points, error = bundle.points_world.copy(), 0.0
    for chunk in pieces:
        error += chunk.normal(T[chunk.cameras], moving[chunk.cameras], derivatives=False)[2]
        points[chunk.rows] = chunk.points
    covariance = np.zeros((len(T), 6, 6))
    if covariances:
        covariance[moving] = _covariances(pieces, T, bundle.fixed)
    return Refined(T, points, covariance, iterations, error, misfit(pieces, T))


def _part(chunk: Chunk, T: Array, moving: Mask) -> Part:
    """The share of a chunk in the cost of the moving cameras; the others stay as they are."""
    here = T[chunk.cameras].copy()
    own = moving[chunk.cameras]
    places = (np.cumsum(moving) - 1)[chunk.cameras[own]]

    def normal(poses: Array, derivatives: bool) -> tuple[Array, Array, float]:
        here[own] = poses
        return chunk.normal(here, own, derivatives)

    return Part(places, normal)


def _covariances(pieces: Sequence[Chunk], T: Array, fixed: Mask) -> Array:
    """Covariance (S, 6, 6) of each moving camera given the fixed ones, tangents (v, w)."""
    moving = ~fixed
    size = int(moving.sum())
    H, B = np.zeros((size, 6, size, 6)), np.zeros((size, 6, size, 6))
    for chunk in pieces:
        here, own = T[chunk.cameras], moving[chunk.cameras]
        places = (np.cumsum(moving) - 1)[chunk.cameras[own]]
        n, block = len(places), np.ix_(places, SIX, places, SIX)
        H[block] += chunk.normal(here, own, derivatives=True)[0].reshape(n, 6, n, 6)
        B[block] += chunk.shares(here, own).reshape(n, 6, n, 6)
    inverse = information_inverse(H.reshape(6 * size, 6 * size))
    spread = _spread(inverse, B.reshape(6 * size, 6 * size))
    blocks = spread.reshape(size, 6, size, 6)[np.arange(size), :, np.arange(size)]
    return blocks[:, TURN_LAST][:, :, TURN_LAST]


def _spread(inverse: Array, B: Array) -> Array:
    """Covariance by residuals, if these are larger than assumed: few points fit too well."""
    if np.trace(B @ inverse) > len(B):
        return inverse @ B @ inverse
    return inverse


def misfit(pieces: Sequence[Chunk], T: Array) -> Array:
    """Median squared residual of pixels and of disparities over what is expected, (2,)."""
    residuals = np.concatenate([chunk.residuals(T[chunk.cameras]) for chunk in pieces])
    known = np.concatenate([chunk.known for chunk in pieces])
    pixels = (residuals[:, :2] ** 2).sum(axis=1)
    disparities = residuals[known[:, 2] > 0, 2] ** 2
    return np.array(
        [
            np.median(squared) / MEDIAN_CHI2[k] if len(squared) else np.nan
            for squared, k in ((pixels, 1), (disparities, 0))
        ]
    )


def refine_motion(
    T_world_cam: Array,
    points_world: Array,
    measured: Array,
    sigma: Array,
    rig: StereoRig,
    settings: RefinementSettings,
) -> Pose:
    """Minimise the reprojection error over one camera, the points staying as they are.

    Args:
        T_world_cam: (4, 4) initial pose.
        points_world: (N, 3) metres.
        measured: (N, 3) left-image u, v and disparity, pixels; NaN where not measured.
        sigma: (N, 3) their standard deviations.
        rig: Projects.
        settings: Loss and iterations.
    """
    seen, known = weigh(measured, sigma, settings.use_disparity)
    points = np.ascontiguousarray(points_world, dtype=np.float64)
    f = intrinsics(rig.K, rig.baseline_m)
    everyone = np.arange(len(points))
    poses, weight, iterations = T_world_cam[None], known, 0

    def normal(poses: Array, derivatives: bool = True) -> tuple[Array, Array, float]:
        R, t = split_pose(poses)
        return camera_normal(R[0], t[0], points, seen, weight, f)

    whole = Part(np.array([0]), normal)
    for _ in range(REWEIGHTINGS if len(points) else 0):
        weight = robust_weights(
            *split_pose(poses), points, 0 * everyone, everyone, seen, known, f, settings.huber
        )
        poses, more = optimize(poses, [whole], settings.max_iterations)
        iterations += more
    R, t = split_pose(poses)
    B = camera_shares(R[0], t[0], points, seen, weight, f)
    covariance = _spread(information_inverse(normal(poses)[0]), B)
    return Pose(poses[0], covariance[TURN_LAST][:, TURN_LAST], iterations)
