"""What the residuals themselves say of a solution's uncertainty.

The inverse of the normal equations is the covariance of a solution whose measurements err
independently, and as much as was assumed. Errors of a landmark's template are in all of its
measurements, and some err more. Taking each landmark's share of the gradient as one draw gives the
covariance without either assumption: H^-1 B H^-1 with B the sum of the shares' outer products
(Liang and Zeger, Biometrika 1986, eq. 7; Huber, 1967).
What all landmarks err alike by, for a stretch of the way, no residual shows.
"""

import numpy as np

from vo.bundle_adjustment.schur import invert
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.contract.projection import stereo_jacobians, stereo_residual


@compiled()
def shares(
    rotations: Array, centres: Array, points: Array, first: Indices, camera: Indices,
    measured: Array, weight: Array, intrinsics: Array, slot: Indices, size: int,
) -> Array:  # fmt: skip
    """Sum of outer products of the points' gradients.

    The arguments are those of `schur.reduce`, the points where that found them.

    Returns:
        (6 S, 6 S) B.
    """
    B, share = np.zeros((6 * size, 6 * size)), np.zeros(6 * size)
    r, F, E = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    V, inverse, pull = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for j in range(len(points)):
        V[:], pull[:] = 0.0, 0.0
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            stereo_residual(
                rotations[i], centres[i], points[j], measured[m], weight[m], intrinsics, r
            )
            stereo_jacobians(rotations[i], centres[i], points[j], weight[m], intrinsics, F, E)
            for p in range(3):
                for k in range(3):
                    pull[p] += E[k, p] * r[k]
                    for q in range(3):
                        V[p, q] += E[k, p] * E[k, q]
        invert(V, inverse)
        moved = -inverse @ pull  # what the point does about it
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            s = slot[i]
            if s < 0:
                continue
            stereo_residual(
                rotations[i], centres[i], points[j], measured[m], weight[m], intrinsics, r
            )
            stereo_jacobians(rotations[i], centres[i], points[j], weight[m], intrinsics, F, E)
            for k in range(3):
                left = r[k] + E[k, 0] * moved[0] + E[k, 1] * moved[1] + E[k, 2] * moved[2]
                for p in range(6):
                    share[6 * s + p] += F[k, p] * left
        for m in range(first[j], first[j + 1]):
            a = slot[camera[m]]
            if a < 0:
                continue
            for other in range(first[j], first[j + 1]):
                b = slot[camera[other]]
                if b < 0:
                    continue
                for p in range(6):
                    for q in range(6):
                        B[6 * a + p, 6 * b + q] += share[6 * a + p] * share[6 * b + q]
        for m in range(first[j], first[j + 1]):
            a = slot[camera[m]]
            if a >= 0:
                share[6 * a : 6 * a + 6] = 0.0
    return B


@compiled()
def camera_shares(
    R: Array, t: Array, points: Array, measured: Array, weight: Array, intrinsics: Array
) -> Array:
    """B (6, 6) of one camera whose points stay."""
    B, g = np.zeros((6, 6)), np.empty(6)
    r, F, E = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    for j in range(len(points)):
        stereo_residual(R, t, points[j], measured[j], weight[j], intrinsics, r)
        stereo_jacobians(R, t, points[j], weight[j], intrinsics, F, E)
        for p in range(6):
            g[p] = F[0, p] * r[0] + F[1, p] * r[1] + F[2, p] * r[2]
        for p in range(6):
            for q in range(6):
                B[p, q] += g[p] * g[q]
    return B
