"""Cameras and points refined together: Levenberg-Marquardt in one compiled loop.

Each step linearizes every measurement once, eliminates the points (Schur complement), solves for
the cameras, and substitutes back. A window of keyframes takes two or three steps.

Source: Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle Adjustment: A Modern Synthesis, 2000,
section 6.1.
"""

from typing import NamedTuple

import numpy as np

from vo.bundle_adjustment.schur import (
    Cameras,
    Measurements,
    invert,
    linearize,
    robust_weights,
    workspace,
)  # fmt: skip
from vo.bundle_adjustment.single_camera import (
    FIRST_DAMPING,
    LIFT,
    MAX_DAMPING,
    RELATIVE_TOLERANCE,
    move,
)  # fmt: skip
from vo.contract.arrays import Array, Indices, copy_values
from vo.contract.compilation import compiled
from vo.contract.projection import stereo_residual


class Solution(NamedTuple):
    """Where an optimisation ended.

    Attributes:
        cameras: K of them.
        points: (J, 3) metres.
        weights: (M, 3) of the measurements in the last step.
        information: (6 S, 6 S) of the S cameras that may move, before the last step.
        cost: Half the sum of squared residuals at the end.
        steps: Number of steps.
    """

    cameras: Cameras
    points: Array
    weights: Array
    information: Array
    cost: float
    steps: int


@compiled()
def optimize_jointly(
    start: Cameras, points: Array, data: Measurements, slot: Indices, huber: float,
    max_iterations: int,
) -> Solution:  # fmt: skip
    """Minimise the Huber cost over cameras and points (J, 3), metres.

    The slot (K,) is the place of each camera among the unknowns; -1 for one that is fixed. The
    weights are renewed after the first step.
    """
    cameras, solved = Cameras(start.R.copy(), start.t.copy()), points.copy()
    weights = robust_weights(cameras, solved, data, huber)
    weighted = Measurements(data.first, data.camera, data.measured, weights, data.intrinsics)
    size = 6 * (slot.max() + 1)
    H = np.empty((size, size))
    steps, cost = _descend(cameras, solved, weighted, slot, H, min(1, max_iterations))
    if steps < max_iterations:
        weights = robust_weights(cameras, solved, data, huber)
        weighted = Measurements(data.first, data.camera, data.measured, weights, data.intrinsics)
        more, cost = _descend(cameras, solved, weighted, slot, H, max_iterations - steps)
        steps += more
    return Solution(cameras, solved, weights, H, cost, steps)


@compiled()
def _descend(
    cameras: Cameras, points: Array, data: Measurements, slot: Indices, H: Array,
    max_iterations: int,
) -> tuple[int, float]:  # fmt: skip
    """Take steps, in place, until the cost hardly falls; return their number and the cost."""
    size, n = len(H), len(points)
    g = np.empty(size)
    W, inverse, b = np.empty((len(data.camera), 6, 3)), np.empty((n, 3, 3)), np.empty((n, 3))
    moved, there = Cameras(cameras.R.copy(), cameras.t.copy()), points.copy()
    cost = 0.0
    for step in range(max_iterations):
        cost = _eliminate(cameras, points, data, slot, H, g, W, inverse, b)
        damping, tried_cost = LIFT, np.inf
        while damping < MAX_DAMPING:
            lifted = H.copy()
            for i in range(size):
                lifted[i, i] += damping * H[i, i] + 1e-12
            tangent = np.linalg.solve(lifted, -g)
            for i in range(len(slot)):
                if slot[i] >= 0:
                    move(cameras, i, tangent[6 * slot[i] : 6 * slot[i] + 6], moved)
            _substitute(points, data, slot, tangent, W, inverse, b, there)
            tried_cost = total_cost(moved, there, data)
            if tried_cost <= cost:
                break
            damping = max(10 * damping, FIRST_DAMPING)
        if not tried_cost <= cost:
            return step, cost
        copy_values(moved.R, cameras.R)
        copy_values(moved.t, cameras.t)
        copy_values(there, points)
        if cost - tried_cost <= RELATIVE_TOLERANCE * cost:
            return step + 1, tried_cost
        cost = tried_cost
    return max_iterations, cost


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _eliminate(
    cameras: Cameras, points: Array, data: Measurements, slot: Indices, H: Array, g: Array,
    W: Array, inverse: Array, b: Array,
) -> float:  # fmt: skip
    """Write the equations of the cameras alone, and what their solution means for the points.

    (6 S, 6 S) information and (6 S,) gradient; products (M, 6, 3) of the derivatives by camera and
    point; inverse informations (J, 3, 3) and gradients (J, 3) of the points. Returns the cost.
    """
    H[:], g[:] = 0.0, 0.0
    cost = 0.0
    r, F, E, V, _, _ = workspace()
    R, t = cameras
    first, camera, measured, weight, intrinsics = data
    Y = np.empty((6, 3))
    for j in range(len(points)):
        V[:], b[j] = 0.0, 0.0
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            linearize(R[i], t[i], points[j], measured[m], weight[m], intrinsics, r, F, E)
            cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            for p in range(3):
                for q in range(p, 3):
                    V[p, q] += E[0, p] * E[0, q] + E[1, p] * E[1, q] + E[2, p] * E[2, q]
                b[j, p] += E[0, p] * r[0] + E[1, p] * r[1] + E[2, p] * r[2]
            if slot[i] < 0:
                continue
            at = 6 * slot[i]
            for p in range(6):
                for q in range(3):
                    W[m, p, q] = F[0, p] * E[0, q] + F[1, p] * E[1, q] + F[2, p] * E[2, q]
                g[at + p] += F[0, p] * r[0] + F[1, p] * r[1] + F[2, p] * r[2]
                for q in range(p, 6):  # the rest is its mirror image
                    H[at + p, at + q] += F[0, p] * F[0, q] + F[1, p] * F[1, q] + F[2, p] * F[2, q]
        invert(V, inverse[j])
        for m in range(first[j], first[j + 1]):
            if slot[camera[m]] < 0:
                continue
            at = 6 * slot[camera[m]]
            for p in range(6):
                for q in range(3):
                    Y[p, q] = (
                        W[m, p, 0] * inverse[j, 0, q]
                        + W[m, p, 1] * inverse[j, 1, q]
                        + W[m, p, 2] * inverse[j, 2, q]
                    )
                g[at + p] -= Y[p, 0] * b[j, 0] + Y[p, 1] * b[j, 1] + Y[p, 2] * b[j, 2]
            for other in range(first[j], first[j + 1]):
                at_other = 6 * slot[camera[other]]
                if at_other < at:
                    continue
                for p in range(6):
                    for q in range(6):
                        H[at + p, at_other + q] -= (
                            Y[p, 0] * W[other, q, 0]
                            + Y[p, 1] * W[other, q, 1]
                            + Y[p, 2] * W[other, q, 2]
                        )
    for p in range(len(g)):
        for q in range(p):
            H[p, q] = H[q, p]
    return cost


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _substitute(
    points: Array, data: Measurements, slot: Indices, tangent: Array, W: Array, inverse: Array,
    b: Array, there: Array,
) -> None:  # fmt: skip
    """Write the points that belong to cameras moved by tangents (6 S,)."""
    total = np.empty(3)
    for j in range(len(points)):
        copy_values(b[j], total)
        for m in range(data.first[j], data.first[j + 1]):
            at = 6 * slot[data.camera[m]]
            if at < 0:
                continue
            for p in range(6):
                for q in range(3):
                    total[q] += W[m, p, q] * tangent[at + p]
        for p in range(3):
            there[j, p] = points[j, p] - (
                inverse[j, p, 0] * total[0] + inverse[j, p, 1] * total[1]
                + inverse[j, p, 2] * total[2]
            )  # fmt: skip


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def total_cost(cameras: Cameras, points: Array, data: Measurements) -> float:
    """Half the sum of squared residuals."""
    cost, r = 0.0, np.empty(3)
    R, t = cameras
    first, camera, measured, weight, intrinsics = data
    for j in range(len(points)):
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            stereo_residual(R[i], t[i], points[j], measured[m], weight[m], intrinsics, r)
            cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    return cost
