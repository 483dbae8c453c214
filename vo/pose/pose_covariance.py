"""How well the inliers determine the camera's pose.

Tangents are (w, v) as in GTSAM's Pose3, rotation first, and move the camera in its own frame:
T_odom_cam @ exp(w, v). Poses are (3, 4) [R | t] with p_cam = R @ p_odom + t.
"""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.pose.gauss_newton import normal_equations, project, solve_symmetric, step, transform

SETTLED = 3
"""Steps from a good pose to the best one."""

NORMAL = 1.4826
"""Standard deviation of a normal variable over the median of its absolute values."""


@compiled(error_model="numpy")
def covariance(points_odom: Array, rays: Array, rows: Indices, pose: Array) -> Array:
    """Covariance (6, 6) of the least-squares pose, the residuals' own spread being its noise.

    The spread is the median absolute residual, scaled to a normal variable's standard deviation.

    Returns:
        NaN if the points do not determine the pose, or leave no residual to judge by.
    """
    count = 2 * len(rows)
    if count <= 6:
        return np.full((6, 6), np.nan)
    information, _ = normal_equations(points_odom, rays, rows, pose)
    inverse = np.eye(6)
    if not solve_symmetric(information, inverse):
        return np.full((6, 6), np.nan)
    residuals = np.empty(count)
    for k, row in enumerate(rows):
        a, b, _ = project(points_odom[row], pose)
        residuals[2 * k] = abs(a - rays[row, 0])
        residuals[2 * k + 1] = abs(b - rays[row, 1])
    return inverse * (NORMAL * np.median(residuals)) ** 2 * count / (count - 6)


@compiled(error_model="numpy")
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
        a, b, inverse_z = project(points_odom[row], best)
        x, y, z = points_cam[row]
        residuals[0, k], residuals[1, k] = abs(a - x / z), abs(b - y / z)
        residuals[2, k] = abs(inverse_z - 1 / z)
    sigma = np.empty(3)
    for i in range(3):
        sigma[i] = NORMAL * np.median(residuals[i]) * np.sqrt(count / (count - 6))

    information, scatter = np.zeros((6, 6)), np.zeros((6, 6))
    pull, noise = np.empty(6), np.zeros((3, 3))
    for row in rows:
        p = transform(points_odom[row], pose)
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
