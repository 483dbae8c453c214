"""Absolute orientation: the rigid motion between two sets of corresponding points (thesis 2.6.1).

Source: Horn, Closed-form solution of absolute orientation using unit quaternions, JOSA A 1987;
Umeyama, Least-squares estimation of transformation parameters, PAMI 1991 (Arun's singular value
decomposition, PAMI 1987, with a rule against mirrors). Scale is forced to 1.
"""

from typing import Literal, TypeAlias

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled

AbsoluteSolver: TypeAlias = Literal["horn", "umeyama"]
ABSOLUTE_SOLVERS: dict[AbsoluteSolver, int] = {"horn": 0, "umeyama": 1}

HORN = ABSOLUTE_SOLVERS["horn"]


def absolute_orientation(
    points_a: Array, points_b: Array, solver: AbsoluteSolver = "umeyama"
) -> Array:
    """Least-squares T_a_b with points_a = T_a_b @ points_b.

    Args:
        points_a: (..., N, 3) metres, N >= 3.
        points_b: (..., N, 3) metres.
        solver: Two ways to the same minimum.

    Returns:
        (..., 4, 4); some rotation of the right fit where the points do not determine one
        (all in a line); NaN where a coordinate is not finite.
    """
    shape = points_a.shape
    flat_a, flat_b = (
        np.ascontiguousarray(p, dtype=np.float64).reshape(-1, *shape[-2:])
        for p in (points_a, points_b)
    )
    return _orient_all(flat_a, flat_b, ABSOLUTE_SOLVERS[solver]).reshape(*shape[:-2], 4, 4)


@compiled()
def _orient_all(points_a: Array, points_b: Array, solver: int) -> Array:
    T_a_b = np.zeros((len(points_a), 4, 4))
    everyone = np.arange(points_a.shape[1])
    for i in range(len(points_a)):
        T_a_b[i, 3, 3] = 1.0
        if not orient(points_a[i], points_b[i], everyone, solver, T_a_b[i, :3]):
            T_a_b[i, :3] = np.nan
    return T_a_b


@compiled()
def orient(points_a: Array, points_b: Array, rows: Indices, solver: int, pose: Array) -> bool:
    """Write the least-squares [R | t], p_a = R @ p_b + t, of some of the points.

    Args:
        points_a: (N, 3) metres.
        points_b: (N, 3) metres.
        rows: (K,) the points that count.
        solver: A value of `ABSOLUTE_SOLVERS`.
        pose: (3, 4) receives the result.

    Returns:
        False if a coordinate is not finite; `pose` is then as it was.
    """
    mean_a, mean_b, spread = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for row in rows:
        mean_a += points_a[row] / len(rows)
        mean_b += points_b[row] / len(rows)
    for row in rows:
        for i in range(3):
            for j in range(3):
                spread[i, j] += (points_a[row, i] - mean_a[i]) * (points_b[row, j] - mean_b[j])
    if not np.isfinite(spread).all():
        return False
    rotation = pose[:, :3]
    if solver == HORN:
        _rotate_horn(spread, rotation)
    else:
        _rotate_umeyama(spread, rotation)
    for i in range(3):
        pose[i, 3] = mean_a[i] - (rotation[i] * mean_b).sum()
    return True


@compiled()
def _rotate_umeyama(spread: Array, rotation: Array) -> None:
    """Rotation that maximises tr(R^T spread): U diag(1, 1, +-1) V^T (Umeyama, eqs. 40 and 43)."""
    U, _, Vt = np.linalg.svd(spread)
    if np.linalg.det(U) * np.linalg.det(Vt) < 0:
        U[:, 2] = -U[:, 2]
    for i in range(3):
        for j in range(3):
            rotation[i, j] = U[i, 0] * Vt[0, j] + U[i, 1] * Vt[1, j] + U[i, 2] * Vt[2, j]


@compiled()
def _rotate_horn(spread: Array, rotation: Array) -> None:
    """The same as the unit quaternion of the largest eigenvalue of a 4 by 4 matrix (Horn, 4.A)."""
    S = spread.T  # Horn's S_xy sums x of the left system, here b, times y of the right one, a
    N = np.zeros((4, 4))
    N[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        N[0, i + 1] = N[i + 1, 0] = S[j, k] - S[k, j]
        N[i + 1, i + 1] = S[i, i] - S[j, j] - S[k, k]
        N[j + 1, k + 1] = N[k + 1, j + 1] = S[j, k] + S[k, j]
    w, x, y, z = np.linalg.eigh(N)[1][:, 3]
    rotation[0, 0], rotation[1, 1], rotation[2, 2] = (
        w * w + x * x - y * y - z * z,
        w * w - x * x + y * y - z * z,
        w * w - x * x - y * y + z * z,
    )
    rotation[0, 1], rotation[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    rotation[0, 2], rotation[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    rotation[1, 2], rotation[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
