"""Gauss-Newton on one camera's reprojection error.

Poses are (3, 4) [R | t] with p_cam = R @ p_odom + t. Tangents are (w, v) as in GTSAM's Pose3,
rotation first, and move the camera in its own frame: T_odom_cam @ exp(w, v).
"""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.contract.projection import compiled_image_jacobian

SINGULAR = 1e-13
"""Smallest share of a diagonal element that Cholesky elimination leaves of a regular matrix."""


@compiled()
def gauss_newton_step(
    points_odom: Array, rays: Array, rows: Indices, pose: Array, moved: Array,
    weights: Array | None = None,
) -> bool:  # fmt: skip
    """Write to `moved` a pose (3, 4) after a Gauss-Newton step on the reprojection error.

    Of the points (N, 3), metres, with rays (N, 2) in normalised image coordinates, the rows (K,)
    count, which lie in front of the camera, by weights (N,) of the squared errors. False if they
    do not determine the pose; `moved` is then as it was.
    """
    information, gradient = normal_equations(points_odom, rays, rows, pose, weights)
    tangent = -gradient
    if not solve_symmetric(information, tangent):
        return False
    _move(pose, tangent, moved)
    return True


@compiled()
def normal_equations(
    points_odom: Array, rays: Array, rows: Indices, pose: Array, weights: Array | None = None
) -> tuple[Array, Array]:
    """Sum J^T J (6, 6) and J^T r (6,) of weighted residuals in normalised image coordinates."""
    information, gradient = np.zeros((6, 6)), np.zeros(6)
    du, dv = np.zeros(6), np.zeros(6)
    for row in rows:
        a, b, inverse_z = _project(points_odom[row], pose)
        ru, rv = a - rays[row, 0], b - rays[row, 1]
        for_u, for_v = compiled_image_jacobian(a, b, inverse_z)
        du[0], du[1], du[2], du[3], du[4], du[5] = for_u
        dv[0], dv[1], dv[2], dv[3], dv[4], dv[5] = for_v
        weight = 1.0 if weights is None else weights[row]
        for i in range(6):
            gradient[i] += weight * (du[i] * ru + dv[i] * rv)
            for j in range(i + 1):
                information[i, j] += weight * (du[i] * du[j] + dv[i] * dv[j])
    for i in range(6):
        for j in range(i):
            information[j, i] = information[i, j]
    return information, gradient


@compiled()
def solve_symmetric(A: Array, b: Array) -> bool:
    """Solve A x = b by Cholesky, in place of b; False if A is not positive definite.

    Only the lower triangle of A is read.
    """
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
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]
    return True


@compiled()
def determines_pose(points_odom: Array, rays: Array, rows: Indices, pose: Array) -> bool:
    """Whether the normal equations of some points at a pose (3, 4) are regular."""
    information, _ = normal_equations(points_odom, rays, rows, pose)
    return solve_symmetric(information, np.zeros(6))


@compiled()
def _project(p: Array, pose: Array) -> tuple[float, float, float]:
    """Project a point (3,) to x / z, y / z and 1 / z."""
    x = pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2] + pose[0, 3]
    y = pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2] + pose[1, 3]
    z = pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2] + pose[2, 3]
    return x / z, y / z, 1 / z


@compiled()
def _move(pose: Array, tangent: Array, moved: Array) -> None:
    """Write [R | t] of T_odom_cam @ exp(w, v), to first order in v: R(-w) (p - v); Rodrigues."""
    w, p = tangent[:3], np.empty(3)
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        s, c = 1.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
    for column in range(4):
        for i in range(3):
            p[i] = pose[i, column] - (tangent[3 + i] if column == 3 else 0.0)
        along = w[0] * p[0] + w[1] * p[1] + w[2] * p[2]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = w[k] * p[j] - w[j] * p[k]  # -w x p
            moved[i, column] = p[i] + s * turned + c * (w[i] * along - angle2 * p[i])
