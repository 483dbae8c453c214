"""Pose in two parts: rotation from far points, translation from near ones (F6).

Source: Tardif, Pavlidis and Daniilidis, Monocular visual odometry in urban environments using an
omnidirectional camera, IROS 2008. There the rotation comes from the epipolar geometry; here far
landmarks lie in directions that a small error of the camera's position does not change.
"""

import numpy as np

from vo.config import MotionSettings
from vo.contract.arrays import Array, Mask
from vo.pose.hypotheses import Problem
from vo.pose.ransac import Consensus, determined_consensus

FAR_SHARE = 0.5
"""Share of the points that count as far; the others count as near."""

ROTATION_TOLERANCE = 3.0
"""Thresholds within which directions agree with a rotation: far points are not at infinity."""

REFITS = 3
"""Least-squares fits of the best rotation, and of the best translation, to their inliers."""

MIN_SINE = 0.02
"""Smallest sine of the angle between two rays that determine a rotation."""


def estimate_decoupled(
    problem: Problem, T_odom_guess: Array, settings: MotionSettings, rng: np.random.Generator
) -> Consensus | None:
    """Estimate the rotation, and with it the translation, each under RANSAC over pairs.

    Of the expected pose only the position matters, to within what is far.
    """
    points_odom, rays, threshold = problem.points_odom, problem.rays, problem.threshold
    legs, pairs = points_odom - T_odom_guess[:3, 3], settings.max_hypotheses
    with np.errstate(over="ignore"):
        distance = np.linalg.norm(legs, axis=1)
    if len(legs) < 4 or not (distance.all() and np.isfinite(distance).all()):
        return None
    far = distance >= np.quantile(distance, 1 - FAR_SHARE)
    if far.sum() < 2 or (~far).sum() < 2:
        return None
    seen = np.column_stack([rays, np.ones(len(rays))])
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    directions = legs[far] / distance[far, None]
    tolerance = ROTATION_TOLERANCE * threshold
    R = _estimate_rotation(directions, seen[far], tolerance, _draw_pairs(far.sum(), pairs, rng))
    if R is None:
        return None
    rotated = points_odom[~far] @ R.T
    t = _estimate_translation(rotated, rays[~far], threshold, _draw_pairs((~far).sum(), pairs, rng))
    return determined_consensus(problem, np.column_stack([R, t]), settings)


def _draw_pairs(count: int, pairs: int, rng: np.random.Generator) -> Array:
    """Draw (pairs, 2) rows, different within a pair."""
    first = rng.integers(0, count, pairs)
    return np.stack([first, (first + rng.integers(1, count, pairs)) % count], axis=1)


def _estimate_rotation(
    directions: Array, seen: Array, threshold: float, pairs: Array
) -> Array | None:
    """Find the R of least cost with seen = R @ directions, by pairs of rays (TRIAD, Black 1964)."""
    before, known = _axes(directions[pairs])
    after, visible = _axes(seen[pairs])
    candidates = (after @ before.swapaxes(1, 2))[known & visible]
    if len(candidates) == 0:
        return None

    def errors(R: Array) -> Array:
        return np.linalg.norm(directions @ R.swapaxes(-1, -2) - seen, axis=-1)

    rotation = candidates[_best(errors(candidates), threshold)]
    for _ in range(REFITS):
        good = errors(rotation) < threshold
        if good.sum() < 2:
            break
        U, _, Vt = np.linalg.svd(seen[good].T @ directions[good])  # Kabsch, 1976
        rotation = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return rotation


def _axes(pairs: Array) -> tuple[Array, Mask]:
    """Build right-handed axes (S, 3, 3), as columns, on pairs (S, 2, 3) of unit rays; if known."""
    normal = np.cross(pairs[:, 0], pairs[:, 1])
    sine = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(sine, MIN_SINE)[:, None]
    axes = [pairs[:, 0], normal, np.cross(pairs[:, 0], normal)]
    return np.stack(axes, axis=2), sine > MIN_SINE


def _estimate_translation(rotated: Array, rays: Array, threshold: float, pairs: Array) -> Array:
    """Find the t of least cost with rays those of rotated + t, by pairs of points."""
    A = np.zeros((len(rotated), 2, 3))  # t_x - x t_z = x z - p_x, and so for y
    A[:, 0, 0] = A[:, 1, 1] = 1
    A[:, :, 2] = -rays
    b = rays * rotated[:, 2:] - rotated[:, :2]

    def errors(t: Array) -> Array:
        points_cam = rotated + t[..., None, :]
        z = points_cam[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.where(z > 0, points_cam[..., :2] / z, np.inf)
        return np.linalg.norm(seen - rays, axis=-1)

    count = len(pairs)
    inverses = np.linalg.pinv(A[pairs].reshape(count, 4, 3))
    candidates = np.einsum("sij,sj->si", inverses, b[pairs].reshape(count, 4))
    t = candidates[_best(errors(candidates), threshold)]
    for _ in range(REFITS):
        good = errors(t) < threshold
        if good.sum() < 2:
            break
        t = np.linalg.pinv(A[good].reshape(-1, 3)) @ b[good].ravel()
    return t


def _best(errors: Array, threshold: float) -> int:
    """Find the hypothesis of (S, N) errors with the least MSAC cost."""
    return int(np.argmin(np.minimum((errors / threshold) ** 2, 1).sum(axis=1)))
