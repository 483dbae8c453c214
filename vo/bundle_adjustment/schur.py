"""The reduced camera system: every point solved for and eliminated, in compiled loops.

Bundle adjustment couples cameras only through the points that they share, and given the cameras
each point is a problem of its own in three unknowns. `reduce` solves it and adds what remains, by
the Schur complement, to the normal equations of the cameras alone: a handful of unknowns instead
of a thousand.

Source: Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle Adjustment: A Modern Synthesis, 2000,
sections 6.1 and 8.1; Golub and Pereyra, variable projection, 1973.
"""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.contract.projection import stereo_jacobians, stereo_residual

POINT_STEPS = 4
CONVERGED = 1e-7
"""A point's step, relative to its norm, that ends its refinement."""

FREE = 1e-9
"""Share of a point's information that is added to each diagonal entry: a point that is seen too
little to be determined stays where it is along what nobody saw."""


@compiled(error_model="numpy")
def robust_weights(
    rotations: Array, centres: Array, points: Array, camera: Indices, point: Indices,
    measured: Array, weight: Array, intrinsics: Array, huber: float,
) -> Array:  # fmt: skip
    """Scale (M, 3) weights so that their squares give the Huber loss of each measurement."""
    scaled = weight.copy()
    r = np.empty(3)
    for m in range(len(camera)):
        i, j = camera[m], point[m]
        stereo_residual(rotations[i], centres[i], points[j], measured[m], weight[m], intrinsics, r)
        size = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        if size > huber:
            for k in range(3):
                scaled[m, k] *= np.sqrt(huber / size)
    return scaled


@compiled(error_model="numpy")
def reduce(
    rotations: Array, centres: Array, points: Array, first: Indices, camera: Indices,
    measured: Array, weight: Array, intrinsics: Array, slot: Indices, size: int,
) -> tuple[Array, Array, float, Array]:  # fmt: skip
    """Solve for every point and eliminate it.

    With `size` 0 and all slots -1 that leaves the cost and the points, for a third of the time.

    Args:
        rotations: (K, 3, 3) of the cameras in the world.
        centres: (K, 3) metres.
        points: (J, 3) where to start.
        first: (J + 1,) where the measurements of each point begin.
        camera: (M,) sorted by point.
        measured: (M, 3) u, v, disparity; anything where the weight is zero.
        weight: (M, 3) one over sigma; zero where nothing was measured.
        intrinsics: fx, fy, cx, cy, and focal length times baseline.
        slot: (K,) place of each camera among the unknowns; -1 for one that is fixed.
        size: Cameras that may move, S.

    Returns:
        (6 S, 6 S) and (6 S,) normal equations of the cameras, half the sum of squares, and the
        (J, 3) points that belong to these cameras.
    """
    H, g = np.zeros((6 * size, 6 * size)), np.zeros(6 * size)
    solved = points.copy()
    cost = 0.0
    r, F, E = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    V, b, inverse = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    most = 1
    for j in range(len(points)):
        most = max(most, first[j + 1] - first[j])
    W = np.empty((most, 6, 3))
    Y = np.empty((most, 6, 3))
    for j in range(len(points)):
        _solve_point(
            rotations, centres, solved[j], first[j], first[j + 1], camera, measured, weight,
            intrinsics, r, F, E, V, b, inverse,
        )  # fmt: skip
        V[:], b[:] = 0.0, 0.0
        for m in range(first[j], first[j + 1]):
            i, n = camera[m], m - first[j]
            stereo_residual(
                rotations[i], centres[i], solved[j], measured[m], weight[m], intrinsics, r
            )
            stereo_jacobians(rotations[i], centres[i], solved[j], weight[m], intrinsics, F, E)
            cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            if size == 0:
                continue
            for p in range(3):
                for q in range(3):
                    V[p, q] += E[0, p] * E[0, q] + E[1, p] * E[1, q] + E[2, p] * E[2, q]
                b[p] += E[0, p] * r[0] + E[1, p] * r[1] + E[2, p] * r[2]
            s = slot[i]
            if s < 0:
                continue
            for p in range(6):
                for q in range(3):
                    W[n, p, q] = F[0, p] * E[0, q] + F[1, p] * E[1, q] + F[2, p] * E[2, q]
                g[6 * s + p] += F[0, p] * r[0] + F[1, p] * r[1] + F[2, p] * r[2]
                for q in range(p, 6):  # the rest is its mirror image
                    H[6 * s + p, 6 * s + q] += (
                        F[0, p] * F[0, q] + F[1, p] * F[1, q] + F[2, p] * F[2, q]
                    )
        if size == 0:
            continue
        invert(V, inverse)
        for m in range(first[j], first[j + 1]):
            s, n = slot[camera[m]], m - first[j]
            if s < 0:
                continue
            for p in range(6):
                for q in range(3):
                    Y[n, p, q] = (
                        W[n, p, 0] * inverse[0, q]
                        + W[n, p, 1] * inverse[1, q]
                        + W[n, p, 2] * inverse[2, q]
                    )
                g[6 * s + p] -= Y[n, p, 0] * b[0] + Y[n, p, 1] * b[1] + Y[n, p, 2] * b[2]
        for m in range(first[j], first[j + 1]):
            s, n = slot[camera[m]], m - first[j]
            if s < 0:
                continue
            for m_other in range(first[j], first[j + 1]):
                s_other, n_other = slot[camera[m_other]], m_other - first[j]
                if s_other < s:
                    continue
                for p in range(6):
                    for q in range(p if s_other == s else 0, 6):
                        H[6 * s + p, 6 * s_other + q] -= (
                            Y[n, p, 0] * W[n_other, q, 0]
                            + Y[n, p, 1] * W[n_other, q, 1]
                            + Y[n, p, 2] * W[n_other, q, 2]
                        )
    for p in range(6 * size):
        for q in range(p):
            H[p, q] = H[q, p]
    return H, g, cost, solved


@compiled(error_model="numpy")
def _solve_point(
    rotations: Array, centres: Array, point: Array, start: int, end: int, camera: Indices,
    measured: Array, weight: Array, intrinsics: Array, r: Array, F: Array, E: Array, V: Array,
    b: Array, inverse: Array,
) -> None:  # fmt: skip
    """Move a point to where its cameras see it, by Gauss–Newton with shortened steps; in place.

    What comes after the intrinsics is room to work in.
    """
    step, tried = np.empty(3), np.empty(3)
    for _ in range(POINT_STEPS):
        V[:], b[:] = 0.0, 0.0
        cost = 0.0
        for m in range(start, end):
            i = camera[m]
            stereo_residual(rotations[i], centres[i], point, measured[m], weight[m], intrinsics, r)
            stereo_jacobians(rotations[i], centres[i], point, weight[m], intrinsics, F, E)
            cost += r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
            for p in range(3):
                for q in range(3):
                    V[p, q] += E[0, p] * E[0, q] + E[1, p] * E[1, q] + E[2, p] * E[2, q]
                b[p] += E[0, p] * r[0] + E[1, p] * r[1] + E[2, p] * r[2]
        invert(V, inverse)
        for p in range(3):
            step[p] = -(inverse[p, 0] * b[0] + inverse[p, 1] * b[1] + inverse[p, 2] * b[2])
        better = False
        for _ in range(4):
            for p in range(3):
                tried[p] = point[p] + step[p]
            new_cost = 0.0
            for m in range(start, end):
                i = camera[m]
                stereo_residual(
                    rotations[i], centres[i], tried, measured[m], weight[m], intrinsics, r
                )
                new_cost += r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
            if new_cost <= cost:
                better = True
                break
            for p in range(3):
                step[p] *= 0.25
        if not better:
            return
        moved2, norm2 = 0.0, 0.0
        for p in range(3):
            point[p] = tried[p]
            moved2 += step[p] * step[p]
            norm2 += point[p] * point[p]
        if moved2 < CONVERGED**2 * norm2:
            return


@compiled(error_model="numpy")
def invert(V: Array, out: Array) -> None:
    """Invert a symmetric positive semi-definite 3x3 matrix, lifted a little off zero."""
    lift = FREE * (V[0, 0] + V[1, 1] + V[2, 2]) + 1e-300
    a, d, f = V[0, 0] + lift, V[1, 1] + lift, V[2, 2] + lift
    b, c, e = V[0, 1], V[0, 2], V[1, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1 / (a * A + b * B + c * C)
    out[0, 0], out[0, 1], out[0, 2] = A * scale, B * scale, C * scale
    out[1, 0], out[1, 1], out[1, 2] = B * scale, (a * f - c * c) * scale, (b * c - a * e) * scale
    out[2, 0], out[2, 1], out[2, 2] = C * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@compiled(error_model="numpy")
def camera_normal(
    R: Array, t: Array, points: Array, measured: Array, weight: Array, intrinsics: Array
) -> tuple[Array, Array, float]:
    """Normal equations of one camera whose points stay: (6, 6), (6,) and half the squares."""
    H, g, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    r, F, E = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    for j in range(len(points)):
        stereo_residual(R, t, points[j], measured[j], weight[j], intrinsics, r)
        stereo_jacobians(R, t, points[j], weight[j], intrinsics, F, E)
        cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        for p in range(6):
            g[p] += F[0, p] * r[0] + F[1, p] * r[1] + F[2, p] * r[2]
            for q in range(6):
                H[p, q] += F[0, p] * F[0, q] + F[1, p] * F[1, q] + F[2, p] * F[2, q]
    return H, g, cost


@compiled(error_model="numpy")
def all_residuals(
    rotations: Array, centres: Array, points: Array, camera: Indices, point: Indices,
    measured: Array, weight: Array, intrinsics: Array,
) -> Array:  # fmt: skip
    """Whitened residuals (M, 3) of all measurements."""
    residuals = np.empty((len(camera), 3))
    for m in range(len(camera)):
        i, j = camera[m], point[m]
        stereo_residual(
            rotations[i], centres[i], points[j], measured[m], weight[m], intrinsics, residuals[m]
        )
    return residuals
