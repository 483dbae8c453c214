"""Covariance of a solution by its residuals: the sandwich estimator, clustered by landmark.

The inverse of the normal equations is the covariance of a solution whose measurements err
independently, and as much as was assumed. Errors of a landmark's template are in all of its
measurements, and some err more. Taking each landmark's score, its part of the gradient, as one draw
gives the covariance without either assumption: H^-1 B H^-1 with B the sum of the scores' outer
products (Liang and Zeger, Biometrika 1986, eq. 7; Huber, 1967).
For a single camera on points that stay, a square of the image is a draw (`single_camera`).
An error that all landmarks have in common over a stretch of the route is in no residual, but it is
larger where the residuals of a template stay alike (`vo.mapping.window_adjustment`).
"""

import numpy as np

from vo.bundle_adjustment.schur import Cameras, Measurements, invert, linearize, workspace
from vo.bundle_adjustment.single_camera import LIFT
from vo.contract.arrays import Array, Indices, copy_values
from vo.contract.compilation import compiled


@compiled()
def widened_covariance(H: Array, B: Array) -> Array:
    """Widen the assumed covariance (N, N), in the directions in which residuals exceed the noise.

    Few draws say nothing of some directions, in which a sandwich would have no width at all.
    """
    lifted = H.copy()
    for i in range(len(H)):
        lifted[i, i] += LIFT * H[i, i] + 1e-12
    information, axes = np.linalg.eigh(lifted)
    whiten = axes / np.sqrt(np.maximum(information, 1e-12))
    excess, turn = np.linalg.eigh(whiten.T @ B @ whiten)
    found = whiten @ turn
    return (found * np.maximum(excess, 1.0)) @ found.T


@compiled()
def camera_covariances(H: Array, B: Array) -> tuple[Array, Array]:
    """Covariances (S, 6, 6) of cameras by normal equations (6 S, 6 S), and their excess (S,).

    The covariances are by the measurements alone, as if these erred independently. The excess is by
    how much the scores of whole landmarks vary more, by their outer products B: the mean over six
    directions. It is large where a template repeats its error from keyframe to keyframe.
    """
    size = len(H) // 6
    lifted = H.copy()
    for i in range(len(H)):
        lifted[i, i] += LIFT * H[i, i] + 1e-12
    inverse = np.linalg.inv(lifted)
    found, excess = np.empty((size, 6, 6)), np.empty(size)
    for i in range(size):
        own = np.ascontiguousarray(inverse[:, 6 * i : 6 * i + 6])
        copy_values(own[6 * i : 6 * i + 6], found[i])
        excess[i] = np.trace(np.linalg.solve(found[i], own.T @ (B @ own))) / 6
    return found, excess


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def score_products(
    cameras: Cameras, points: Array, data: Measurements, slot: Indices, size: int
) -> Array:
    """Sum the outer products of the points' scores: (6 S, 6 S).

    The arguments are those of `schur.eliminate_points`, the points those that it returned.
    """
    B, score = np.zeros((6 * size, 6 * size)), np.zeros(6 * size)
    r, F, E, V, b, inverse = workspace()
    R, t = cameras
    first, camera, measured, weight, intrinsics = data
    for j in range(len(points)):
        V[:], b[:] = 0.0, 0.0
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            linearize(R[i], t[i], points[j], measured[m], weight[m], intrinsics, r, F, E)
            for p in range(3):
                for k in range(3):
                    b[p] += E[k, p] * r[k]
                    for q in range(3):
                        V[p, q] += E[k, p] * E[k, q]
        invert(V, inverse)
        step = -inverse @ b  # of the point, by its own measurements
        for m in range(first[j], first[j + 1]):
            i = camera[m]
            s = slot[i]
            if s < 0:
                continue
            linearize(R[i], t[i], points[j], measured[m], weight[m], intrinsics, r, F, E)
            for k in range(3):
                left = r[k] + E[k, 0] * step[0] + E[k, 1] * step[1] + E[k, 2] * step[2]
                for p in range(6):
                    score[6 * s + p] += F[k, p] * left
        for m in range(first[j], first[j + 1]):
            s = slot[camera[m]]
            if s < 0:
                continue
            for m_other in range(first[j], first[j + 1]):
                s_other = slot[camera[m_other]]
                if s_other < s:  # the rest is its mirror image
                    continue
                for p in range(6):
                    for q in range(6):
                        B[6 * s + p, 6 * s_other + q] += score[6 * s + p] * score[6 * s_other + q]
        for m in range(first[j], first[j + 1]):
            s = slot[camera[m]]
            if s >= 0:
                for p in range(6):
                    score[6 * s + p] = 0.0
    for p in range(6 * size):
        for q in range(p):
            B[p, q] = B[q, p]
    return B
