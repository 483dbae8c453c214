"""The reduced camera system: every point solved for and eliminated, in compiled loops.

Bundle adjustment couples cameras only through the points that they share, and given the cameras
each point is a problem of its own in three unknowns. `eliminate_points` solves it and adds its
Schur complement to the normal equations of the cameras alone.

Source: Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle Adjustment: A Modern Synthesis, 2000,
sections 6.1 and 8.1; Golub and Pereyra, variable projection, 1973.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.contract.projection import stereo_jacobians, stereo_residual

POINT_STEPS = 4
"""Largest number of Gauss-Newton steps of a point for given cameras."""

CONVERGED = 1e-4
"""Step of a point, relative to its norm, that ends its refinement."""

DAMPING = 1e-9
"""Share of a point's information that is added to each diagonal entry: along directions that no
measurement determines, the point stays where it is."""


class Cameras(NamedTuple):
    """Poses of cameras in the world: (K, 3, 3) rotations and (K, 3) centres, metres."""

    R: Array
    t: Array


class Measurements(NamedTuple):
    """Measurements of points, sorted by point.

    Attributes:
        first: (J + 1,) where the measurements of each point begin.
        camera: (M,) index of the camera.
        measured: (M, 3) u, v, disparity, pixels; anything where the weight is zero.
        weight: (M, 3) one over sigma; zero where nothing was measured.
        intrinsics: (5,) fx, fy, cx, cy, and focal length times baseline.
    """

    first: Indices
    camera: Indices
    measured: Array
    weight: Array
    intrinsics: Array


class Workspace(NamedTuple):
    """Arrays that are written anew for every measurement or point.

    Residual r (3,) of a measurement, its derivatives F (3, 6) by the camera's tangent (w, v) and
    E (3, 3) by the point; the point's information V (3, 3), its inverse, and gradient b (3,).
    """

    r: Array
    F: Array
    E: Array
    V: Array
    b: Array
    inverse: Array


@compiled()
def workspace() -> Workspace:
    """Allocate a workspace."""
    return Workspace(
        np.empty(3), np.empty((3, 6)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3),
        np.empty((3, 3)),
    )  # fmt: skip


@compiled()
def robust_weights(cameras: Cameras, points: Array, data: Measurements, huber: float) -> Array:
    """Scale weights (M, 3) so that their squares give the Huber loss, linear beyond `huber`.

    The loss is of the norm of a measurement's whole residual, in sigmas.
    """
    scaled = data.weight.copy()
    r = np.empty(3)
    for j in range(len(points)):
        for m in range(data.first[j], data.first[j + 1]):
            _residual(cameras, points[j], data, m, r)
            size = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            if size > huber:
                for k in range(3):
                    scaled[m, k] *= np.sqrt(huber / size)
    return scaled


@compiled()
def residuals(cameras: Cameras, points: Array, data: Measurements) -> Array:
    """Compute the residuals (M, 3) of all measurements, in sigmas."""
    found = np.empty((len(data.camera), 3))
    for j in range(len(points)):
        for m in range(data.first[j], data.first[j + 1]):
            _residual(cameras, points[j], data, m, found[m])
    return found


@compiled()
def point_information(cameras: Cameras, points: Array, data: Measurements) -> Array:
    """Information (J, 3, 3) of each point, given the cameras."""
    work, found = workspace(), np.zeros((len(points), 3, 3))
    for j in range(len(points)):
        for m in range(data.first[j], data.first[j + 1]):
            k = data.camera[m]
            linearize(
                cameras.R[k], cameras.t[k], points[j], data.measured[m], data.weight[m],
                data.intrinsics, work.r, work.F, work.E,
            )  # fmt: skip
            _add_point_terms(work.r, work.E, found[j], work.b)
    return found


@compiled()
def eliminate_points(
    cameras: Cameras, points: Array, data: Measurements, slot: Indices, size: int
) -> tuple[Array, Array, float, Array]:
    """Solve for every point and eliminate it.

    The points (J, 3) are where to start. The slot (K,) is the place of each camera among the S
    unknowns, `size`; -1 for one that is fixed. With size 0 and all slots -1 that leaves the cost
    and the points, for a third of the time.

    Returns:
        (6 S, 6 S) and (6 S,) normal equations of the cameras, half the sum of squares, and the
        (J, 3) points that belong to these cameras.
    """
    H, g = np.zeros((6 * size, 6 * size)), np.zeros(6 * size)
    solved = points.copy()
    cost = 0.0
    work = workspace()
    r, F, E, V, b, inverse = work
    R, t = cameras
    first, camera, measured, weight, intrinsics = data
    most = 1
    for j in range(len(points)):
        most = max(most, first[j + 1] - first[j])
    W = np.empty((most, 6, 3))
    Y = np.empty((most, 6, 3))
    for j in range(len(points)):
        _solve_point(cameras, solved[j], data, j, work)
        V[:], b[:] = 0.0, 0.0
        for m in range(first[j], first[j + 1]):
            i, n = camera[m], m - first[j]
            linearize(R[i], t[i], solved[j], measured[m], weight[m], intrinsics, r, F, E)
            cost += 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            if size == 0:
                continue
            _add_point_terms(r, E, V, b)
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


@compiled()
def _solve_point(
    cameras: Cameras, point: Array, data: Measurements, j: int, work: Workspace
) -> None:
    """Minimise the cost of point j by Gauss-Newton with shortened steps; in place."""
    r, F, E, V, b, inverse = work
    R, t = cameras
    first, camera, measured, weight, intrinsics = data
    start, end = first[j], first[j + 1]
    step, tried = np.empty(3), np.empty(3)
    for _ in range(POINT_STEPS):
        V[:], b[:] = 0.0, 0.0
        cost = 0.0
        for m in range(start, end):
            i = camera[m]
            linearize(R[i], t[i], point, measured[m], weight[m], intrinsics, r, F, E)
            cost += r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
            _add_point_terms(r, E, V, b)
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
                stereo_residual(R[i], t[i], tried, measured[m], weight[m], intrinsics, r)
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


@compiled(inline="always")
def _residual(cameras: Cameras, point: Array, data: Measurements, m: int, out: Array) -> None:
    i = data.camera[m]
    stereo_residual(
        cameras.R[i], cameras.t[i], point, data.measured[m], data.weight[m], data.intrinsics, out
    )


@compiled()
def invert(V: Array, out: Array) -> None:
    """Invert a symmetric positive semi-definite 3x3 matrix, lifted a little off zero."""
    lift = DAMPING * (V[0, 0] + V[1, 1] + V[2, 2]) + 1e-300
    a, d, f = V[0, 0] + lift, V[1, 1] + lift, V[2, 2] + lift
    b, c, e = V[0, 1], V[0, 2], V[1, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1 / (a * A + b * B + c * C)
    out[0, 0], out[0, 1], out[0, 2] = A * scale, B * scale, C * scale
    out[1, 0], out[1, 1], out[1, 2] = B * scale, (a * f - c * c) * scale, (b * c - a * e) * scale
    out[2, 0], out[2, 1], out[2, 2] = C * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@compiled(inline="always")
def linearize(
    R: Array, t: Array, point: Array, measured: Array, weight: Array, intrinsics: Array, r: Array,
    F: Array, E: Array,
) -> None:  # fmt: skip
    """Write residual and derivatives of one measurement, as in a workspace.

    It is inlined, and its arguments are no named tuples: to count the references to their arrays
    would take longer than the work.
    """
    stereo_residual(R, t, point, measured, weight, intrinsics, r)
    stereo_jacobians(R, t, point, weight, intrinsics, F, E)


@compiled(inline="always")
def _add_point_terms(r: Array, E: Array, V: Array, b: Array) -> None:
    """Add the measurement that was linearized last to the normal equations of its point."""
    for p in range(3):
        for q in range(3):
            V[p, q] += E[0, p] * E[0, q] + E[1, p] * E[1, q] + E[2, p] * E[2, q]
        b[p] += E[0, p] * r[0] + E[1, p] * r[1] + E[2, p] * r[2]
