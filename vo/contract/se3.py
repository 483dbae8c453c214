"""Rigid motions as 4x4 matrices named so that products cancel: p_a = T_a_b @ p_b.

Tangents are (v, w): translation in metres first, then rotation in radians.
Every function takes stacks: leading dimensions are carried through.
"""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from vo.contract.arrays import Array

SMALL_ANGLE_RAD = 1e-4
"""Below this the series of exp and log are exact to double precision."""


def pose(R: Array, t: Array) -> Array:
    """Assemble (..., 4, 4) T_a_b from R_a_b (..., 3, 3) and b's origin in a (..., 3), metres."""
    shape, of_t = np.shape(R)[:-2], np.shape(t)[:-1]
    T = np.zeros((*(shape if shape == of_t else np.broadcast_shapes(shape, of_t)), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def inverse(T_a_b: Array) -> Array:
    """Return T_b_a (..., 4, 4) in closed form."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return pose(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def transform(T_a_b: Array, points_b: Array) -> Array:
    """Map points: (4, 4) and (N, 3) points_b to (N, 3) points_a, metres."""
    return points_b @ T_a_b[..., :3, :3].swapaxes(-1, -2) + T_a_b[..., None, :3, 3]


def skew(w: Array) -> Array:
    """Return [w]x (..., 3, 3), so that [w]x @ p = w x p."""
    w = np.asarray(w, dtype=float)
    S = np.zeros((*w.shape[:-1], 3, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -w[..., 2], w[..., 1], -w[..., 0]
    return S - np.swapaxes(S, -1, -2)


def adjoint(T_a_b: Array) -> Array:
    """Return Ad (6, 6) with T_a_b exp(x) = exp(Ad x) T_a_b, for tangents (v, w)."""
    R, Ad = T_a_b[:3, :3], np.zeros((6, 6))
    Ad[:3, :3] = Ad[3:, 3:] = R
    Ad[:3, 3:] = skew(T_a_b[:3, 3]) @ R
    return Ad


def transform_covariance(T_a_b: Array, covariance_b: Array) -> Array:
    """Express the covariance (6, 6) of a tangent in frame b in frame a, rigid with it."""
    Ad = adjoint(T_a_b)
    return Ad @ covariance_b @ Ad.T


def _left_jacobian(w: Array) -> Array:
    """V(w) with exp(v, w) = (R, V v); Barfoot, State Estimation for Robotics, eq. 7.77."""
    theta = np.linalg.norm(w, axis=-1)[..., None, None]
    small = theta < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 0.5 - theta**2 / 24, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1 / 6 - theta**2 / 120, (safe - np.sin(safe)) / safe**3)
    S = skew(w)
    return np.eye(3) + a * S + b * (S @ S)


def exp(tangent: Array) -> Array:
    """Exponential map: tangent (..., 6) as (v m, w rad) to (..., 4, 4)."""
    tangent = np.asarray(tangent, dtype=float)
    v, w = tangent[..., :3], tangent[..., 3:]
    R = Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(*w.shape[:-1], 3, 3)
    return pose(R, (_left_jacobian(w) @ v[..., None])[..., 0])


def log(T: Array) -> Array:
    """Logarithm map: (..., 4, 4) to tangent (..., 6) as (v m, w rad), |w| <= pi."""
    w = rotation_vector(T)
    v = np.linalg.solve(_left_jacobian(w), T[..., :3, 3:])[..., 0]
    return np.concatenate([v, w], axis=-1)


def log_small(T: Array) -> Array:
    """Logarithm (6,) of a small motion (4, 4), exact to the square of its angle; it is quicker."""
    (_, ab, ac, x), (ba, _, bc, y), (ca, cb, _, z), _ = T.tolist()
    p, q, r = (cb - bc) / 2, (ac - ca) / 2, (ba - ab) / 2
    v = x - (q * z - r * y) / 2, y - (r * x - p * z) / 2, z - (p * y - q * x) / 2
    return np.array([*v, p, q, r])


def rotation_vector(T: Array) -> Array:
    """Rotation part of (..., 4, 4) as axis times angle (..., 3) in radians."""
    R = np.reshape(T[..., :3, :3], (-1, 3, 3))
    return Rotation.from_matrix(R).as_rotvec().reshape(*T.shape[:-2], 3)


def rotation_angle(T: Array) -> Array:
    """Angle of the rotation part of (..., 4, 4), radians in [0, pi]."""
    return np.linalg.norm(rotation_vector(T), axis=-1)


def from_quat_wxyz(quat_wxyz: Array, t: Array) -> Array:
    """(..., 4, 4) from unit quaternions (..., 4), scalar first, and positions (..., 3), metres."""
    quat = np.reshape(quat_wxyz, (-1, 4))
    R = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    return pose(R.reshape(*np.shape(quat_wxyz)[:-1], 3, 3), t)


def to_quat_wxyz(T: Array) -> Array:
    """Unit quaternions (..., 4), scalar first and not negative, of (..., 4, 4)."""
    R = np.reshape(T[..., :3, :3], (-1, 3, 3))
    quat = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    return quat.reshape(*T.shape[:-2], 4)


def nearest_rotation(matrix: Array) -> tuple[Array, Array]:
    """Find the rotation U diag(1, 1, +-1) V^T that is nearest to a matrix (3, 3), by least squares.

    Of a scatter matrix sum(a b^T) that is the R of least squares with a = R @ b. With it come the
    singular values (3,), signed alike.

    Source: Umeyama, Least-squares estimation of transformation parameters between two point
    patterns, PAMI 13(4), 1991, eqs. 38 to 43; Kabsch, 1976.
    """
    U, D, Vt = np.linalg.svd(matrix)
    S = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    return (U * S) @ Vt, D * S


def orthonormal(T: Array) -> Array:
    """Take the rounding of many products out of rotations of poses (..., 4, 4).

    Source: One Newton step of the polar decomposition (Higham, 1986), exact to its square.
    """
    R = T[..., :3, :3]
    return pose(R @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(R, -1, -2) @ R), T[..., :3, 3])


def interpolate(known: Array, T: Array, queried: Array) -> Array:
    """Poses (K, 4, 4) at parameters `queried` (K,) between poses (N, 4, 4) at `known` (N,), N >= 2.

    Linear in position, spherical in rotation; `known` increases and spans `queried`.
    """
    R = Slerp(known, Rotation.from_matrix(T[:, :3, :3]))(queried).as_matrix()
    return pose(R, np.stack([np.interp(queried, known, T[:, k, 3]) for k in range(3)], axis=-1))
