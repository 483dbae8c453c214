"""Absolute orientation: the rigid motion between two sets of corresponding points (thesis 2.6.1).

Source: Horn, Closed-form solution of absolute orientation using unit quaternions, JOSA A 1987.
Scale is forced to 1.
"""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled


@compiled()
def absolute_orientation(points_a: Array, points_b: Array, rows: Indices, pose: Array) -> bool:
    """Write the least-squares [R | t] (3, 4), p_a = R @ p_b + t, of points (N, 3), metres.

    At least three rows (K,) count. Where the points do not determine a rotation (all in a line),
    some rotation of the right fit. False if a coordinate is not finite; `pose` is then as it was.
    """
    mean_a, mean_b, scatter = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for row in rows:
        for i in range(3):
            mean_a[i] += points_a[row, i] / len(rows)
            mean_b[i] += points_b[row, i] / len(rows)
    for row in rows:
        for i in range(3):
            for j in range(3):
                scatter[i, j] += (points_a[row, i] - mean_a[i]) * (points_b[row, j] - mean_b[j])
    for i in range(3):
        for j in range(3):
            if not np.isfinite(scatter[i, j]):
                return False
    _write_rotation(scatter, pose)
    for i in range(3):
        x, y, z = pose[i, 0] * mean_b[0], pose[i, 1] * mean_b[1], pose[i, 2] * mean_b[2]
        pose[i, 3] = mean_a[i] - (x + y + z)
    return True


@compiled()
def _write_rotation(scatter: Array, pose: Array) -> None:
    """Write the R that maximises tr(R^T scatter): its unit quaternion is an eigenvector (4.A)."""
    S = scatter.T  # Horn's S_xy sums x of the left system, here b, times y of the right one, a
    N = np.zeros((4, 4))
    N[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        N[0, i + 1] = N[i + 1, 0] = S[j, k] - S[k, j]
        N[i + 1, i + 1] = S[i, i] - S[j, j] - S[k, k]
        N[j + 1, k + 1] = N[k + 1, j + 1] = S[j, k] + S[k, j]
    w, x, y, z = np.linalg.eigh(N)[1][:, 3]
    pose[0, 0] = w * w + x * x - y * y - z * z
    pose[1, 1] = w * w - x * x + y * y - z * z
    pose[2, 2] = w * w - x * x - y * y + z * z
    pose[0, 1], pose[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    pose[0, 2], pose[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    pose[1, 2], pose[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)
