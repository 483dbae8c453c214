"""Camera pose from three points: the perspective-three-point problem (thesis 2.6.2).

A solver finds the three legs of the tetrahedron from the camera to the points; Newton's method on
the three laws of cosines makes them exact; the motion between the two congruent triangles is the
pose. (Absolute orientation of congruent triangles needs no least squares.)

Vectors of three are written out by component: Numba compiles each expression of arrays, and each
reduction, as a function of its own, which takes five times as long.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.pose.fischler_bolles import legs_fischler_bolles
from vo.pose.lambda_twist import legs_lambda_twist

SOLVERS = {"fischler_bolles": 0, "lambda_twist": 1}
FISCHLER_BOLLES = SOLVERS["fischler_bolles"]

MAX_CANDIDATES = 8
"""Largest number of candidates that a solver finds."""

COLLINEAR = 1e-12
"""Squared sine below which three points count as collinear."""

NEWTON_STEPS = 6
"""Largest number of Newton steps on a candidate."""

MAX_RESIDUAL = 1e-10
"""Largest error of the laws of cosines of a solution, as a share of the squared sides."""

SAME = 1e-9
"""Relative difference of legs below which two candidates are one solution."""


@compiled()
def p3p(points_ref: Array, rays_cam: Array, solver: int, poses: Array) -> int:
    """Write the poses (4, 3, 4) [R | t] that see points (3, 3) along unit rays (3, 3).

    p_cam = R @ p_ref + t. The solver is a value of `SOLVERS`. Return the number of solutions, zero
    for degenerate points or rays (collinear, coincident, NaN).
    """
    sides2, cosines, legs = np.zeros(3), np.zeros(3), np.empty((MAX_CANDIDATES, 3))
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        for n in range(3):
            sides2[k] += (points_ref[i, n] - points_ref[j, n]) ** 2
            cosines[k] += rays_cam[i, n] * rays_cam[j, n]
    total = sides2[0] + sides2[1] + sides2[2]
    if not np.isfinite(total) or is_collinear(points_ref) or is_collinear(rays_cam):
        return 0
    if solver == FISCHLER_BOLLES:
        candidates = legs_fischler_bolles(sides2, cosines, legs)
    else:
        candidates = legs_lambda_twist(sides2, cosines, legs)
    found = 0
    for k in range(candidates):
        if not _refine(legs[k], sides2, cosines):
            continue
        fresh = found < 4
        a, b, c = legs[k]
        for other in range(found):
            A, B, C = legs[other]
            fresh = fresh and max(abs(a - A), abs(b - B), abs(c - C)) > SAME * max(a, b, c)
        if fresh:
            legs[found, 0], legs[found, 1], legs[found, 2] = a, b, c
            _triangle_motion(points_ref, rays_cam, legs[found], poses[found])
            found += 1
    return found


@compiled()
def is_collinear(corners: Array) -> bool:
    """Whether three points (3, 3) are, to rounding, in a line, or not finite."""
    (ox, oy, oz), (ax, ay, az), (bx, by, bz) = corners[0], corners[1], corners[2]
    ax, ay, az, bx, by, bz = ax - ox, ay - oy, az - oz, bx - ox, by - oy, bz - oz
    area2 = (ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2
    longest2 = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz)
    return not area2 > COLLINEAR * longest2 * longest2


@compiled()
def _refine(legs: Array, sides2: Array, cosines: Array) -> bool:
    """Refine legs (3,) by Newton's method on the laws of cosines; False if these do not hold."""
    a, b, c = legs
    cos_ab, cos_ac, cos_bc = cosines
    error = np.inf
    for _ in range(NEWTON_STEPS):
        e0 = a * a + b * b - 2 * a * b * cos_ab - sides2[0]
        e1 = a * a + c * c - 2 * a * c * cos_ac - sides2[1]
        e2 = b * b + c * c - 2 * b * c * cos_bc - sides2[2]
        now = max(abs(e0), abs(e1), abs(e2))
        if not now < error:
            break
        error = now
        legs[0], legs[1], legs[2] = a, b, c
        p, q = 2 * (a - b * cos_ab), 2 * (b - a * cos_ab)
        r, s = 2 * (a - c * cos_ac), 2 * (c - a * cos_ac)
        u, v = 2 * (b - c * cos_bc), 2 * (c - b * cos_bc)
        determinant = -p * s * u - q * r * v
        if determinant == 0:
            break
        a -= (-s * u * e0 - q * v * e1 + q * s * e2) / determinant
        b -= (-r * v * e0 + p * v * e1 - p * s * e2) / determinant
        c -= (r * u * e0 - p * u * e1 - q * r * e2) / determinant
    exact = error <= MAX_RESIDUAL * max(sides2[0], sides2[1], sides2[2])
    return exact and min(legs[0], legs[1], legs[2]) > 0


@compiled()
def _triangle_motion(points_ref: Array, rays_cam: Array, legs: Array, pose: Array) -> None:
    """Write the [R | t] that carries the triangle of the points to the one at the legs' ends."""
    points_cam, here, there = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        for i in range(3):
            points_cam[k, i] = legs[k] * rays_cam[k, i]
    _axes(points_cam, here)
    _axes(points_ref, there)
    for i in range(3):
        pose[i, 3] = (points_cam[0, i] + points_cam[1, i] + points_cam[2, i]) / 3
        for j in range(3):
            pose[i, j] = (
                here[0, i] * there[0, j] + here[1, i] * there[1, j] + here[2, i] * there[2, j]
            )
        for j in range(3):
            pose[i, 3] -= pose[i, j] * (points_ref[0, j] + points_ref[1, j] + points_ref[2, j]) / 3


@compiled()
def _axes(corners: Array, axes: Array) -> None:
    """Write unit axes as rows: along a triangle's first side, across it, normal to the plane."""
    u, v, normal = axes
    for k in range(3):
        u[k], v[k] = corners[1, k] - corners[0, k], corners[2, k] - corners[0, k]
    _divide(u, np.sqrt(_dot(u, u)))
    along = _dot(u, v)
    for k in range(3):
        v[k] -= along * u[k]
    _divide(v, np.sqrt(_dot(v, v)))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        normal[i] = u[j] * v[k] - u[k] * v[j]


@compiled()
def _dot(u: Array, v: Array) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@compiled()
def _divide(v: Array, divisor: float) -> None:
    for k in range(3):
        v[k] /= divisor
