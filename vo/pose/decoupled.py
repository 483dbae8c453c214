"""The camera's motion in two parts: rotation from far points, translation from near ones (F6).

Source: Tardif, Pavlidis and Daniilidis, Monocular visual odometry in urban environments using an
omnidirectional camera, IROS 2008. There the rotation comes from the epipolar geometry; here far
landmarks are seen in directions that a small error of the camera's position does not change.
"""

import numpy as np

from vo.contract.arrays import Array, Mask

FAR_SHARE = 0.5
"""Share of the points that count as far; the others as near."""

LOOSE = 3.0
"""Thresholds within which directions agree: far is not infinitely far."""

REFITS = 3
LEAST_SINE = 0.02
"""Of the angle between two rays that shall determine a rotation."""


def split_motion(
    points_odom: Array,
    rays: Array,
    T_odom_guess: Array,
    threshold: float,
    trials: int,
    rng: np.random.Generator,
) -> Array | None:
    """Estimate the rotation, and with it the translation, each under RANSAC over pairs.

    Args:
        points_odom: (N, 3) landmarks, metres.
        rays: (N, 2) normalised image coordinates where the camera sees them.
        T_odom_guess: (4, 4) guessed pose; only its position matters, to within what is far.
        threshold: Largest error of an inlier, normalised.
        trials: Pairs drawn for either.
        rng: Draws them.

    Returns:
        (3, 4) [R | t] with p_cam = R @ p_odom + t, or None if there are too few points.
    """
    legs = points_odom - T_odom_guess[:3, 3]
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
    R = _rotation(directions, seen[far], LOOSE * threshold, _pairs(far.sum(), trials, rng))
    if R is None:
        return None
    turned = points_odom[~far] @ R.T
    t = _translation(turned, rays[~far], threshold, _pairs((~far).sum(), trials, rng))
    return np.column_stack([R, t])


def _pairs(count: int, trials: int, rng: np.random.Generator) -> Array:
    """(trials, 2) rows, different within a pair."""
    first = rng.integers(0, count, trials)
    return np.stack([first, (first + rng.integers(1, count, trials)) % count], axis=1)


def _rotation(directions: Array, seen: Array, threshold: float, pairs: Array) -> Array | None:
    """The R of least cost with seen = R @ directions, by two rays each (TRIAD, Black 1964)."""
    before, known = _frames(directions[pairs])
    after, visible = _frames(seen[pairs])
    candidates = (after @ before.swapaxes(1, 2))[known & visible]
    if len(candidates) == 0:
        return None

    def errors(R: Array) -> Array:
        return np.linalg.norm(directions @ R.swapaxes(-1, -2) - seen, axis=-1)

    turn = candidates[_best(errors(candidates), threshold)]
    for _ in range(REFITS):
        good = errors(turn) < threshold
        if good.sum() < 2:
            break
        U, _, V = np.linalg.svd(seen[good].T @ directions[good])  # Kabsch, 1976
        turn = U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V
    return turn


def _frames(pairs: Array) -> tuple[Array, Mask]:
    """Right-handed axes (S, 3, 3), as columns, of pairs (S, 2, 3) of unit rays."""
    normal = np.cross(pairs[:, 0], pairs[:, 1])
    sine = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(sine, LEAST_SINE)[:, None]
    axes = [pairs[:, 0], normal, np.cross(pairs[:, 0], normal)]
    return np.stack(axes, axis=2), sine > LEAST_SINE


def _translation(turned: Array, rays: Array, threshold: float, pairs: Array) -> Array:
    """The t of least cost with rays those of turned + t, by two points each."""
    A = np.zeros((len(turned), 2, 3))  # t_x - x t_z = x z - p_x, and so for y
    A[:, 0, 0] = A[:, 1, 1] = 1
    A[:, :, 2] = -rays
    b = rays * turned[:, 2:] - turned[:, :2]

    def solve(rows: Array) -> Array:
        return np.linalg.pinv(A[rows].reshape(-1, 3)) @ b[rows].ravel()

    def errors(t: Array) -> Array:
        points_cam = turned + t[..., None, :]
        z = points_cam[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.where(z > 0, points_cam[..., :2] / z, np.inf)
        return np.linalg.norm(seen - rays, axis=-1)

    many = pairs.shape[0]
    inverses = np.linalg.pinv(A[pairs].reshape(many, 4, 3))
    candidates = np.einsum("sij,sj->si", inverses, b[pairs].reshape(many, 4))
    t = candidates[_best(errors(candidates), threshold)]
    for _ in range(REFITS):
        good = errors(t) < threshold
        if good.sum() < 2:
            break
        t = solve(np.flatnonzero(good))
    return t


def _best(errors: Array, threshold: float) -> int:
    """The hypothesis of (S, N) errors with the least MSAC cost."""
    return int(np.argmin(np.minimum((errors / threshold) ** 2, 1).sum(axis=1)))
