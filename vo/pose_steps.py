"""Gauss-Newton on one camera's reprojection error, and what it knows about the pose.

Poses are (3, 4) [R | t] with p_cam = R @ p_odom + t. Tangents are (w, v) as in GTSAM's Pose3,
rotation first, and move the camera in its own frame: T_odom_cam @ exp(w, v).
"""

import numba
import numpy as np

from vo.contract.arrays import Array, Indices

SINGULAR = 1e-13
"""Share of a diagonal element that elimination must leave of it."""

SETTLED = 3
"""Steps from a good pose to the best one."""

NORMAL = 1.4826
"""Standard deviation of a normal variable over the median of its absolute values."""


@numba.njit(cache=True, error_model="numpy")
def step(points_odom: Array, rays: Array, rows: Indices, pose: Array, moved: Array) -> bool:
    """One Gauss-Newton step on the reprojection error of some points.

    Args:
        points_odom: (N, 3) metres.
        rays: (N, 2) normalised image coordinates.
        rows: (K,) the points that count, in front of the camera.
        pose: (3, 4).
        moved: (3, 4) receives the better pose.

    Returns:
        False if the points do not determine the pose; `moved` is then as it was.
    """
    information, gradient = _normal_equations(points_odom, rays, rows, pose)
    tangent = np.empty((6, 1))
    for k in range(6):
        tangent[k, 0] = -gradient[k]
    if not solve_symmetric(information, tangent):
        return False
    _move(pose, tangent[:, 0], moved)
    return True


@numba.njit(cache=True, error_model="numpy")
def covariance(points_odom: Array, rays: Array, rows: Indices, pose: Array) -> Array:
    """Covariance (6, 6) of the least-squares pose, the residuals' own spread being its noise.

    The spread is the median absolute residual, scaled to a normal variable's standard deviation.

    Returns:
        NaN if the points do not determine the pose, or leave no residual to judge by.
    """
    count = 2 * len(rows)
    if count <= 6:
        return np.full((6, 6), np.nan)
    information, _ = _normal_equations(points_odom, rays, rows, pose)
    inverse = np.eye(6)
    if not solve_symmetric(information, inverse):
        return np.full((6, 6), np.nan)
    residuals = np.empty(count)
    for k, row in enumerate(rows):
        a, b, _ = _project(points_odom[row], pose)
        residuals[2 * k] = abs(a - rays[row, 0])
        residuals[2 * k + 1] = abs(b - rays[row, 1])
    return inverse * (NORMAL * np.median(residuals)) ** 2 * count / (count - 6)


@numba.njit(cache=True, error_model="numpy")
def covariance_of_points(
    points_odom: Array, points_cam: Array, rows: Indices, pose: Array
) -> Array:
    """Covariance (6, 6) of the absolute orientation of some points.

    It weighs all points alike, though stereo's noise is even in x / z, y / z and 1 / z only. The
    spread of these, each from its median absolute residual, is propagated. The residuals are those
    of the pose that fits the rays best: at this one, its own error would count as noise.

    Returns:
        NaN if the points do not determine the pose, or leave no residual to judge by.
    """
    count = 3 * len(rows)
    if count <= 6:
        return np.full((6, 6), np.nan)
    rays = points_cam[:, :2] / points_cam[:, 2:]
    best = pose.copy()
    for _ in range(SETTLED):
        step(points_odom, rays, rows, best, best)
    residuals = np.empty((3, len(rows)))
    for k, row in enumerate(rows):
        a, b, inverse_z = _project(points_odom[row], best)
        x, y, z = points_cam[row]
        residuals[0, k], residuals[1, k] = abs(a - x / z), abs(b - y / z)
        residuals[2, k] = abs(inverse_z - 1 / z)
    sigma = np.empty(3)
    for i in range(3):
        sigma[i] = NORMAL * np.median(residuals[i]) * np.sqrt(count / (count - 6))

    information, scatter = np.zeros((6, 6)), np.zeros((6, 6))
    pull, noise = np.empty(6), np.zeros((3, 3))
    for row in rows:
        p = _transform(points_odom[row], pose)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # p x w - v, squared
            information[i, i] += p[j] * p[j] + p[k] * p[k]
            information[i, j] -= p[i] * p[j]
            information[j, i] -= p[i] * p[j]
            information[3 + i, 3 + i] += 1.0
            information[j, 3 + k] -= p[i]
            information[3 + k, j] -= p[i]
            information[k, 3 + j] += p[i]
            information[3 + j, k] += p[i]
            noise[2, i] = -p[2] * p[i] * sigma[2]
        noise[0, 0], noise[1, 1] = p[2] * sigma[0], p[2] * sigma[1]
        for e in noise:
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                pull[i], pull[3 + i] = e[j] * p[k] - e[k] * p[j], -e[i]
            for i in range(6):
                for j in range(6):
                    scatter[i, j] += pull[i] * pull[j]
    inverse = np.eye(6)
    if not solve_symmetric(information, inverse):
        return np.full((6, 6), np.nan)
    return inverse @ scatter @ inverse


@numba.njit(cache=True, error_model="numpy")
def _normal_equations(
    points_odom: Array, rays: Array, rows: Indices, pose: Array
) -> tuple[Array, Array]:
    """J^T J (6, 6) and J^T r (6,) of the residuals in normalised image coordinates."""
    information, gradient = np.zeros((6, 6)), np.zeros(6)
    du, dv = np.zeros(6), np.zeros(6)
    for row in rows:
        a, b, inverse_z = _project(points_odom[row], pose)
        ru, rv = a - rays[row, 0], b - rays[row, 1]
        du[0], du[1], du[2], du[3], du[5] = a * b, -1 - a * a, b, -inverse_z, a * inverse_z
        dv[0], dv[1], dv[2], dv[4], dv[5] = 1 + b * b, -a * b, -a, -inverse_z, b * inverse_z
        for i in range(6):
            gradient[i] += du[i] * ru + dv[i] * rv
            for j in range(i + 1):
                information[i, j] += du[i] * du[j] + dv[i] * dv[j]
    for i in range(6):
        for j in range(i):
            information[j, i] = information[i, j]
    return information, gradient


@numba.njit(cache=True, error_model="numpy")
def solve_symmetric(A: Array, B: Array) -> bool:
    """Solve A X = B in place of B by Cholesky; False, and B spoilt, if A is not positive."""
    n = len(A)
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            rest = A[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            if i == j:
                if not rest > SINGULAR * A[i, i]:
                    return False
                L[i, i] = np.sqrt(rest)
            else:
                L[i, j] = rest / L[j, j]
    for c in range(B.shape[1]):
        for i in range(n):
            for k in range(i):
                B[i, c] -= L[i, k] * B[k, c]
            B[i, c] /= L[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                B[i, c] -= L[k, i] * B[k, c]
            B[i, c] /= L[i, i]
    return True


@numba.njit(cache=True, error_model="numpy")
def _transform(p: Array, pose: Array) -> tuple[float, float, float]:
    return (
        pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2] + pose[0, 3],
        pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2] + pose[1, 3],
        pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2] + pose[2, 3],
    )


@numba.njit(cache=True, error_model="numpy")
def _project(p: Array, pose: Array) -> tuple[float, float, float]:
    """Normalised image coordinates and inverse depth: x / z, y / z, 1 / z."""
    x, y, z = _transform(p, pose)
    return x / z, y / z, 1 / z


@numba.njit(cache=True, error_model="numpy")
def _move(pose: Array, tangent: Array, moved: Array) -> None:
    """[R | t] of T_odom_cam @ exp(w, v), to first order in v: R(-w) (p - v); Rodrigues."""
    w, v = tangent[:3], tangent[3:]
    angle2 = (w * w).sum()
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        s, c = 1.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
    for column in range(4):
        p = pose[:, column].copy()
        if column == 3:
            p -= v
        along = (w * p).sum()
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = w[k] * p[j] - w[j] * p[k]  # -w x p
            moved[i, column] = p[i] + s * turned + c * (w[i] * along - angle2 * p[i])
