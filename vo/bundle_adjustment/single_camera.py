"""One camera refined on points that stay: Levenberg-Marquardt in one compiled loop.

Every frame needs it, with six unknowns; a graph built for it would take longer than its solution.
"""

from typing import NamedTuple

import numpy as np

from vo.bundle_adjustment.schur import Cameras
from vo.contract.arrays import Array, copy_values
from vo.contract.compilation import compiled
from vo.contract.projection import MIN_DEPTH_M

REWEIGHTINGS = 3
"""Rounds in which the Huber weights are renewed (Holland and Welsch, 1977)."""

RELATIVE_TOLERANCE = 1e-4
"""Relative decrease of the cost that ends an optimisation, or a round of it."""

FIRST_DAMPING, MAX_DAMPING = 1e-4, 1e4
"""Shares of its own that are added to the diagonal of the normal equations where a step fails."""

LIFT = 1e-9
"""Share that is always added: directions that nothing determines stay as they are."""

CELLS = 6
"""Squares along the image's width, in each of which errors may be alike: those of the points of one
surface that is no plane, or that moves by itself."""


class Seen(NamedTuple):
    """Measurements of N points by one camera, in columns.

    Attributes:
        points: (3, N) x, y, z in the world, metres.
        measured: (3, N) u, v, disparity, pixels; anything where the weight is zero.
        weight: (3, N) one over sigma; zero where nothing was measured.
        common: (3, N) share c of the error that u, v and disparity have in common, by the depth of
            the point: residuals in sigmas and their derivatives are multiplied by I - c cᵀ.
        here: (3, N) the points in the camera; written with the residuals.
        residual: (3, N) in sigmas, independent.
    """

    points: Array
    measured: Array
    weight: Array
    common: Array
    here: Array
    residual: Array


@compiled()
def refine_camera(
    T_world_cam: Array, points: Array, spread: Array, measured: Array, sigma: Array,
    use_disparity: bool, intrinsics: Array, huber: float, max_iterations: int,
) -> tuple[Array, Array, Array, int]:  # fmt: skip
    """Minimise the Huber cost of one camera (4, 4) over its measurements of points (N, 3), metres.

    The points are known to within a standard deviation along a vector, the spread (N, 3). Measured
    are (N, 3) u, v and disparity, or NaN, with (N, 3) sigmas. Returns the camera, its normal
    equations (6, 6) by the tangent (w, v), the sum (6, 6) of the outer products of the scores by
    cells of the image, and the steps.
    """
    n = len(points)
    columns = np.zeros((6, 3, n))
    data = Seen(columns[0], columns[1], columns[2], columns[3], columns[4], columns[5])
    robust = Seen(
        data.points, data.measured, np.empty((3, n)), data.common, data.here, data.residual
    )
    for j in range(n):
        for k in range(3):
            data.points[k, j] = points[j, k]
            if not np.isnan(measured[j, k]) and (k < 2 or use_disparity):
                data.measured[k, j], data.weight[k, j] = measured[j, k], 1 / sigma[j, k]
    camera = Cameras(np.empty((1, 3, 3)), np.empty((1, 3)))
    copy_values(T_world_cam[:3, :3], camera.R[0])
    copy_values(T_world_cam[:3, 3], camera.t[0])
    _residuals(camera.R[0], camera.t[0], data, intrinsics)
    _write_common(camera.R[0], spread, data, intrinsics)
    J, steps = np.zeros((6, 3, n)), 0
    for _ in range(REWEIGHTINGS if n else 0):
        _residuals(camera.R[0], camera.t[0], data, intrinsics)
        _reweight(data.weight, data.residual, huber, robust.weight)
        steps += _descend(camera, robust, intrinsics, max_iterations, J)
    _residuals(camera.R[0], camera.t[0], robust, intrinsics)
    _differentiate(robust, intrinsics, J)
    by_all, scores = J.reshape(6, 3 * n), _scores(J, robust.residual)
    B = _products_of_cells(scores, data.measured, 2 * max(intrinsics[2], 1.0) / CELLS)
    R = camera.R[0]
    T = np.eye(4)
    # Less the rounding of many products.
    copy_values(R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R)), T[:3, :3])
    copy_values(camera.t[0], T[:3, 3])
    return T, by_all @ by_all.T, B, steps


@compiled()
def _descend(camera: Cameras, data: Seen, intrinsics: Array, max_iterations: int, J: Array) -> int:
    """Take Levenberg-Marquardt steps, in place, until the cost hardly falls; return their number.

    Every step begins undamped: where the cost is nearly quadratic that is Gauss-Newton.
    """
    cost = _residuals(camera.R[0], camera.t[0], data, intrinsics)
    moved = Cameras(camera.R.copy(), camera.t.copy())
    by_all = J.reshape(6, J.size // 6)
    for step in range(max_iterations):
        _differentiate(data, intrinsics, J)
        H, g = by_all @ by_all.T, by_all @ data.residual.ravel()
        damping, tried_cost = LIFT, np.inf
        while damping < MAX_DAMPING:
            lifted = H.copy()
            for i in range(6):
                lifted[i, i] += damping * H[i, i] + 1e-12
            move(camera, 0, np.linalg.solve(lifted, -g), moved)
            tried_cost = _residuals(moved.R[0], moved.t[0], data, intrinsics)
            if tried_cost <= cost:
                break
            damping = max(10 * damping, FIRST_DAMPING)
        if not tried_cost <= cost:
            return step
        copy_values(moved.R, camera.R)
        copy_values(moved.t, camera.t)
        if cost - tried_cost <= RELATIVE_TOLERANCE * cost:
            return step + 1
        cost = tried_cost
    return max_iterations


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _residuals(R: Array, t: Array, data: Seen, intrinsics: Array) -> float:
    """Write points in the camera and residuals; return half the sum of squares."""
    points, measured, weight, common, here, residual = data
    fx, fy, cx, cy, fb = intrinsics
    cost = 0.0
    for j in range(np.uint64(points.shape[1])):
        dx, dy, dz = points[0, j] - t[0], points[1, j] - t[1], points[2, j] - t[2]
        x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
        y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
        z = max(R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz, MIN_DEPTH_M)
        u = weight[0, j] * (fx * x / z + cx - measured[0, j])
        v = weight[1, j] * (fy * y / z + cy - measured[1, j])
        d = weight[2, j] * (fb / z - measured[2, j])
        here[0, j], here[1, j], here[2, j] = x, y, z
        p, q, r = common[0, j], common[1, j], common[2, j]
        along = p * u + q * v + r * d
        u, v, d = u - p * along, v - q * along, d - r * along
        residual[0, j], residual[1, j], residual[2, j] = u, v, d
        cost += 0.5 * (u * u + v * v + d * d)
    return cost


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _write_common(R: Array, spread: Array, data: Seen, intrinsics: Array) -> None:
    """Write what residuals in sigmas have in common by the spread (N, 3) of points in a camera.

    Their covariance is I + b bᵀ, where b are derivatives along the spread; its inverse is the
    square of I - c cᵀ with c along b.
    """
    fx, fy, _, _, fb = intrinsics
    weight, common, here = data.weight, data.common, data.here
    for j in range(np.uint64(here.shape[1])):
        x, y, z = here[0, j], here[1, j], here[2, j]
        sx, sy, sz = spread[j, 0], spread[j, 1], spread[j, 2]
        dx = R[0, 0] * sx + R[1, 0] * sy + R[2, 0] * sz
        dy = R[0, 1] * sx + R[1, 1] * sy + R[2, 1] * sz
        dz = R[0, 2] * sx + R[1, 2] * sy + R[2, 2] * sz
        u = weight[0, j] * fx * (dx - x / z * dz) / z
        v = weight[1, j] * fy * (dy - y / z * dz) / z
        d = -weight[2, j] * fb * dz / (z * z)
        square = max(u * u + v * v + d * d, 1e-12)
        scale = np.sqrt((1 - 1 / np.sqrt(1 + square)) / square)
        common[0, j], common[1, j], common[2, j] = scale * u, scale * v, scale * d


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _differentiate(data: Seen, intrinsics: Array, J: Array) -> None:
    """Write the derivatives (6, 3, N) of residuals by the tangent (w, v)."""
    fx, fy, _, _, fb = intrinsics
    weight, common, here = data.weight, data.common, data.here
    for j in range(np.uint64(here.shape[1])):
        x, y, z = here[0, j], here[1, j], here[2, j]
        # Rows (a, 0, c), (0, b, d), (0, 0, e) of d residual / d point in the camera's frame, and
        # the camera moves by (w, v) in its own frame: d point = point x w - v.
        a, b, e = weight[0, j] * fx / z, weight[1, j] * fy / z, -weight[2, j] * fb / (z * z)
        c, d = -a * x / z, -b * y / z
        p, q, r = common[0, j], common[1, j], common[2, j]
        u, v, w = -c * y, b * z - d * y, -e * y
        s = p * u + q * v + r * w
        J[0, 0, j], J[0, 1, j], J[0, 2, j] = u - p * s, v - q * s, w - r * s
        u, v, w = c * x - a * z, d * x, e * x
        s = p * u + q * v + r * w
        J[1, 0, j], J[1, 1, j], J[1, 2, j] = u - p * s, v - q * s, w - r * s
        u, v = a * y, -b * x
        s = p * u + q * v
        J[2, 0, j], J[2, 1, j], J[2, 2, j] = u - p * s, v - q * s, -r * s
        s = -p * a
        J[3, 0, j], J[3, 1, j], J[3, 2, j] = -a - p * s, -q * s, -r * s
        s = -q * b
        J[4, 0, j], J[4, 1, j], J[4, 2, j] = -p * s, -b - q * s, -r * s
        s = -(p * c + q * d + r * e)
        J[5, 0, j], J[5, 1, j], J[5, 2, j] = -c - p * s, -d - q * s, -e - r * s


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _reweight(weight: Array, residual: Array, huber: float, robust: Array) -> None:
    """Scale weights so that their squares give the Huber loss of each point's residual."""
    for j in range(np.uint64(weight.shape[1])):
        u, v, d = residual[0, j], residual[1, j], residual[2, j]
        size = np.sqrt(u * u + v * v + d * d)
        scale = np.sqrt(huber / max(size, huber))
        for k in range(3):
            robust[k, j] = weight[k, j] * scale


@compiled()
def _scores(J: Array, residual: Array) -> Array:
    """Each point's part (6, N) of the gradient."""
    scores = np.empty((6, J.shape[2]))
    for p in range(6):
        for j in range(J.shape[2]):
            scores[p, j] = (
                J[p, 0, j] * residual[0, j]
                + J[p, 1, j] * residual[1, j]
                + J[p, 2, j] * residual[2, j]
            )
    return scores


@compiled()
def _products_of_cells(scores: Array, measured: Array, side_px: float) -> Array:
    """Sum the outer products (6, 6) of the scores of squares of the image.

    A score is a sum over the points (6, N) in a square, whose errors may be dependent. That six
    numbers were fitted to few squares is made up for.

    Source: Cameron and Miller, A Practitioner's Guide to Cluster-Robust Inference, 2015, eq. 11.
    """
    sums, used = np.zeros((CELLS * CELLS, 6)), np.zeros(CELLS * CELLS)
    for j in range(scores.shape[1]):
        column = min(max(int(measured[0, j] / side_px), 0), CELLS - 1)
        row = min(max(int(measured[1, j] / side_px), 0), CELLS - 1)
        cell = row * CELLS + column
        used[cell] = 1.0
        for p in range(6):
            sums[cell, p] += scores[p, j]
    count = used.sum()
    return sums.T @ sums * (count / max(count - 6, 0.5 * count, 1.0))


@compiled()
def move(camera: Cameras, i: int, tangent: Array, moved: Cameras) -> None:
    """Write T_world_cam @ exp(w, v) of camera i, to first order in v."""
    w, v = tangent[:3], tangent[3:]
    angle2 = (w * w).sum()
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        s, c = 1.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
    turn = np.empty((3, 3))
    for p in range(3):
        q, k = (p + 1) % 3, (p + 2) % 3
        turn[p, p] = 1 + c * (w[p] * w[p] - angle2)
        turn[p, q] = c * w[p] * w[q] - s * w[k]
        turn[p, k] = c * w[p] * w[k] + s * w[q]
    copy_values(camera.R[i] @ turn, moved.R[i])
    copy_values(camera.t[i] + camera.R[i] @ v, moved.t[i])
