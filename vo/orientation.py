"""Absolute orientation: the rigid motion between two sets of corresponding points (thesis 2.6.1).

Source: Arun, Huang and Blostein, PAMI 1987, with the reflection rule of Umeyama, PAMI 1991,
eq. 43; scale forced to 1.
"""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array


def absolute_orientation(points_a: Array, points_b: Array) -> Array:
    """Least-squares T_a_b with points_a = T_a_b @ points_b.

    Args:
        points_a: (..., N, 3) metres, N >= 3.
        points_b: (..., N, 3) metres.

    Returns:
        (..., 4, 4); some rotation of the right fit where the points do not determine one
        (all in a line).
    """
    mean_a = points_a.mean(axis=-2, keepdims=True)
    mean_b = points_b.mean(axis=-2, keepdims=True)
    covariance = np.swapaxes(points_a - mean_a, -1, -2) @ (points_b - mean_b)
    U, _, Vt = np.linalg.svd(covariance)
    reflected = np.linalg.det(U) * np.linalg.det(Vt) < 0
    U[..., :, 2] *= np.where(reflected, -1.0, 1.0)[..., None]
    R_a_b = U @ Vt
    t = mean_a - mean_b @ np.swapaxes(R_a_b, -1, -2)
    return se3.pose(R_a_b, t[..., 0, :])
