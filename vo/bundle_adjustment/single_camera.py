"""One camera refined on points that stay: Levenberg-Marquardt in one compiled loop.

Every frame needs it, with six unknowns; a graph built for it would take longer than its solution.
"""

import numpy as np

from vo.bundle_adjustment.schur import Cameras, Measurements, linearize, robust_weights, workspace
from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.projection import stereo_residual

REWEIGHTINGS = 3
"""Rounds in which the Huber weights are renewed (Holland and Welsch, 1977)."""

RELATIVE_TOLERANCE = 1e-4
"""Relative decrease of the cost that ends an optimisation, or a round of it."""

FIRST_DAMPING, MAX_DAMPING = 1e-4, 1e4
"""Shares of its own that are added to the diagonal of the normal equations where a step fails."""

LIFT = 1e-9
"""Share that is always added: directions that nothing determines stay as they are."""


@compiled()
def refine_camera(
    T_world_cam: Array, points: Array, measured: Array, sigma: Array, use_disparity: bool,
    intrinsics: Array, huber: float, max_iterations: int,
) -> tuple[Array, Array, Array, int]:  # fmt: skip
    """Minimise the Huber cost of one camera (4, 4) over its measurements of points (N, 3), metres.

    Measured are (N, 3) u, v and disparity, or NaN, with (N, 3) sigmas. Returns the camera, its
    normal equations (6, 6) by the tangent (w, v), the sum (6, 6) of the outer products of the
    points' scores, and the steps.
    """
    n = len(points)
    seen, weight = measured.copy(), np.zeros((n, 3))
    for j in range(n):
        for k in range(3 if use_disparity else 2):
            if np.isnan(measured[j, k]):
                seen[j, k] = 0.0
            else:
                weight[j, k] = 1 / sigma[j, k]
    each = np.arange(n + 1)
    data = Measurements(each, np.zeros(n, np.int64), seen, weight, intrinsics)
    camera = Cameras(np.empty((1, 3, 3)), np.empty((1, 3)))
    camera.R[0], camera.t[0] = T_world_cam[:3, :3], T_world_cam[:3, 3]
    steps, weighted = 0, data
    for _ in range(REWEIGHTINGS if n else 0):
        weights = robust_weights(camera, points, data, huber)
        weighted = Measurements(data.first, data.camera, data.measured, weights, data.intrinsics)
        steps += _descend(camera, points, weighted, max_iterations)
    H, _, _, B = _normal_equations(camera, points, weighted)
    R = camera.R[0]
    T = np.eye(4)
    T[:3, :3] = R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R))  # rounding of many products
    T[:3, 3] = camera.t[0]
    return T, H, B, steps


@compiled()
def _descend(camera: Cameras, points: Array, data: Measurements, max_iterations: int) -> int:
    """Take Levenberg-Marquardt steps, in place, until the cost hardly falls; return their number.

    Every step begins undamped: where the cost is nearly quadratic that is Gauss-Newton.
    """
    for step in range(max_iterations):
        H, g, cost, _ = _normal_equations(camera, points, data)
        damping, tried_cost = LIFT, np.inf
        moved = Cameras(camera.R.copy(), camera.t.copy())
        while damping < MAX_DAMPING:
            lifted = H.copy()
            for i in range(6):
                lifted[i, i] += damping * H[i, i] + 1e-12
            move(camera, 0, np.linalg.solve(lifted, -g), moved)
            tried_cost = _cost(moved, points, data)
            if tried_cost <= cost:
                break
            damping = max(10 * damping, FIRST_DAMPING)
        if not tried_cost <= cost:
            return step
        camera.R[:], camera.t[:] = moved.R, moved.t
        if cost - tried_cost <= RELATIVE_TOLERANCE * cost:
            return step + 1
    return max_iterations


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _normal_equations(
    cameras: Cameras, points: Array, data: Measurements
) -> tuple[Array, Array, float, Array]:
    """(6, 6) and (6,) normal equations, half the sum of squares, and score products (6, 6)."""
    H, g, B, score = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.empty(6)
    cost = 0.0
    r, F, E, _, _, _ = workspace()
    R, t = cameras.R[0], cameras.t[0]
    _, _, measured, weight, intrinsics = data
    for j in range(len(points)):
        linearize(R, t, points[j], measured[j], weight[j], intrinsics, r, F, E)
        cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        for p in range(6):
            score[p] = F[0, p] * r[0] + F[1, p] * r[1] + F[2, p] * r[2]
            g[p] += score[p]
            for q in range(p + 1):
                H[p, q] += F[0, p] * F[0, q] + F[1, p] * F[1, q] + F[2, p] * F[2, q]
                B[p, q] += score[p] * score[q]
    for p in range(6):
        for q in range(p):
            H[q, p], B[q, p] = H[p, q], B[p, q]
    return H, g, cost, B


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _cost(cameras: Cameras, points: Array, data: Measurements) -> float:
    """Half the sum of squared residuals."""
    cost, r = 0.0, np.empty(3)
    R, t = cameras.R[0], cameras.t[0]
    for j in range(len(points)):
        stereo_residual(R, t, points[j], data.measured[j], data.weight[j], data.intrinsics, r)
        cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    return cost


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
    moved.R[i] = camera.R[i] @ turn
    moved.t[i] = camera.t[i] + camera.R[i] @ v
