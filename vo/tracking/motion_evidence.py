"""Evidence of flow for a small motion of the camera: what part of it some motion explains.

Nearly every frame asks, of a few hundred landmarks: all of it is one compiled loop.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.contract.projection import compiled_image_jacobian
from vo.contract.rig import StereoRig
from vo.pose.gauss_newton import solve_symmetric

MAD_TO_SIGMA = 1.4826
"""From the median absolute value of normal errors to their standard deviation."""

RIDGE = 1e-12
"""Share of the trace that is added to the diagonal: what no landmark determines stays at rest."""


class FlowFit(NamedTuple):
    """Parameters of the robust fit of a motion to flow."""

    min_landmarks: int = 12
    """Landmarks that can tell motion from noise."""
    min_noise_px: float = 0.01
    """Of a pixel's flow: alignment converges to no better."""
    outlier_sigmas: float = 3.0
    """Standard deviations of flow beyond which a landmark moves by itself."""
    reweightings: int = 5
    """Iterations of the robust fit."""


FLOW_FIT = FlowFit()


def motion_evidence(points_cam: Array, flow_px: Array, rig: StereoRig, along: Array) -> float:
    """Part of the flow that a small motion explains: chi-squared, K degrees of freedom.

    The noise is that of the flow which no motion explains; what moves by itself is left out.
    Infinite if hardly anything remains. The points (N, 3) are in metres, their flow (N, 2) in the
    left image; (6, K) are the tangents of the motions in question.

    Source: Analysis of variance, after least absolute deviations by reweighting.
    """
    turn_first = np.ascontiguousarray(along[[3, 4, 5, 0, 1, 2]], dtype=np.float64)
    flow_px = np.ascontiguousarray(flow_px, dtype=np.float64)
    return _evidence(np.ascontiguousarray(points_cam), flow_px, rig.f_px, turn_first)


@compiled()
def _evidence(points: Array, flow: Array, f_px: float, along: Array) -> float:
    """Compute `motion_evidence` by tangents (6, K) in the order (w, v)."""
    jacobian = _differentiate(points, f_px, along)
    n, weight, left = len(flow), np.ones(len(flow)), np.empty_like(flow)
    noise_px = FLOW_FIT.min_noise_px
    for _ in range(FLOW_FIT.reweightings):
        motion = _fit(jacobian, flow, weight, n)
        _subtract(jacobian, motion, flow, left, n)
        noise_px = _noise(left, n)
        for i in range(n):
            weight[i] = 1 / max(max(abs(left[i, 0]), abs(left[i, 1])) / noise_px, 1.0)
    own, kept, most = np.empty_like(flow), 0, FLOW_FIT.outlier_sigmas * noise_px
    for i in range(n):
        if max(abs(left[i, 0]), abs(left[i, 1])) < most:
            for k in range(2):
                own[kept, k] = flow[i, k]
                for p in range(jacobian.shape[2]):
                    jacobian[kept, k, p] = jacobian[i, k, p]
            kept += 1
    if kept < FLOW_FIT.min_landmarks:
        return np.inf
    weight[:kept] = 1.0
    motion = _fit(jacobian, own, weight, kept)
    _subtract(jacobian, motion, own, left, kept)
    noise_px, explained = _noise(left, kept), 0.0
    for i in range(kept):
        for k in range(2):
            explained += (own[i, k] - left[i, k]) ** 2
    return explained / (noise_px * noise_px)


@compiled()
def _differentiate(points: Array, f_px: float, along: Array) -> Array:
    """Differentiate u and v of points (N, 3) by the motions along tangents (6, K): (N, 2, K)."""
    size = along.shape[1]
    found = np.zeros((len(points), 2, size))
    du, dv = np.empty(6), np.empty(6)
    for i in range(len(points)):
        inverse_z = 1 / points[i, 2]
        x, y = points[i, 0] * inverse_z, points[i, 1] * inverse_z
        for_u, for_v = compiled_image_jacobian(x, y, inverse_z)
        du[0], du[1], du[2], du[3], du[4], du[5] = for_u
        dv[0], dv[1], dv[2], dv[3], dv[4], dv[5] = for_v
        for k in range(size):
            for j in range(6):
                found[i, 0, k] += f_px * du[j] * along[j, k]
                found[i, 1, k] += f_px * dv[j] * along[j, k]
    return found


@compiled()
def _fit(jacobian: Array, flow: Array, weight: Array, count: int) -> Array:
    """Fit a motion (K,) to the first of the flow (N, 2), as many as `count`, by weights (N,)."""
    size = jacobian.shape[2]
    information, motion = np.zeros((size, size)), np.zeros(size)
    for i in range(count):
        for k in range(2):
            for p in range(size):
                row = weight[i] * jacobian[i, k, p]
                motion[p] += row * flow[i, k]
                for q in range(p + 1):
                    information[p, q] += row * jacobian[i, k, q]
    trace = 0.0
    for p in range(size):
        trace += information[p, p]
    for p in range(size):
        information[p, p] += RIDGE * trace
    if not solve_symmetric(information, motion):  # reads the lower triangle
        motion[:] = 0.0
    return motion


@compiled()
def _subtract(jacobian: Array, motion: Array, flow: Array, left: Array, count: int) -> None:
    """Write the flow (N, 2) that a motion (K,) leaves unexplained."""
    for i in range(count):
        for k in range(2):
            rest = flow[i, k]
            for p in range(len(motion)):
                rest -= jacobian[i, k, p] * motion[p]
            left[i, k] = rest


@compiled()
def _noise(left: Array, count: int) -> float:
    """Return the standard deviation, px, of most of the first of the flow (N, 2)."""
    size = np.empty(2 * count)
    for i in range(count):
        size[2 * i], size[2 * i + 1] = abs(left[i, 0]), abs(left[i, 1])
    middle = np.median(size)
    return max(MAD_TO_SIGMA * middle, FLOW_FIT.min_noise_px)
