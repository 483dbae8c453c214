"""Slant of the surface at a feature, from the intensities of its two images.

The aligner's Gauss–Newton with three unknowns: the disparity and its slopes along u and v. It needs
no neighbours, but is several times noisier than a plane through the disparities of many.

Source: Devernay and Faugeras, Computing Differential Properties of 3-D Shapes from Stereoscopic
Images without 3-D Models, CVPR 1994; inverse compositional as in `vo.patches.alignment`.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.alignment import MIN_NORM, sample, warp_offsets
from vo.patches.templates import Templates

MAX_STEPS = 10
"""Largest number of Gauss–Newton steps."""

CONVERGED_PX = 0.02
"""Largest motion of the patch's corners in the last step."""

MAX_SLOPE = 0.6
"""Largest slope of a fit, pixels per pixel."""


def fit_patch_slopes(templates: Templates, right: Image, pixels_right: Array) -> Array:
    """Find the slant (N, 2), the change of disparity along u and v, that makes patches most alike.

    The positions of the left image's templates in the right image, (N, 2), are right to within
    about two pixels. NaN where the fit left the image or did not converge.
    """
    return _fit_all(templates, right, np.ascontiguousarray(pixels_right, dtype=np.float64))


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _fit_all(templates: Templates, right: Image, start: Array) -> Array:
    patches, gradients, norms, _ = templates
    slopes = np.full((len(norms), 2), np.nan)
    side = patches.shape[1]
    r = side // 2
    offsets = np.empty((2, side * side), dtype=np.float32)
    now = np.empty(side * side, dtype=np.float32)
    jacobian = np.empty((3, side * side), dtype=np.float32)
    warp = np.eye(3, 2)
    for i in range(len(patches)):
        if not norms[i] > MIN_NORM:
            continue
        _differentiate(patches[i], gradients[i, 0], jacobian)
        hessian = jacobian @ jacobian.T
        if not np.linalg.det(hessian) > 1e-6:
            continue
        inverse = np.linalg.inv(hessian)
        u, v = start[i]
        warp[0, 0], warp[0, 1] = 1.0, 0.0
        for _ in range(MAX_STEPS):
            reach_u, reach_v = warp_offsets(warp, side, offsets)
            inside = u - reach_u >= 0 and u + reach_u < right.shape[1] - 1
            inside = inside and v - reach_v >= 0 and v + reach_v < right.shape[0] - 1
            if not inside:
                break
            norm = sample(right, u, v, offsets, now)
            if not norm > MIN_NORM:
                break
            # The increment, a map of the row u -> p0 + (1 + p1) u + p2 v, is undone.
            p = inverse @ (jacobian @ now) / norm
            scale = warp[0, 0] / (1 + p[1])
            u -= scale * p[0]
            warp[0, 0], warp[0, 1] = scale, warp[0, 1] - scale * p[2]
            steep = abs(1 - scale) > MAX_SLOPE or abs(warp[0, 1]) > MAX_SLOPE
            if steep or abs(u - start[i, 0]) > r:
                break
            if abs(p[0]) + r * (abs(p[1]) + abs(p[2])) < CONVERGED_PX:
                slopes[i, 0], slopes[i, 1] = 1 - scale, -warp[0, 1]
                break
    return slopes


@compiled(fastmath={"reassoc", "contract"})
def _differentiate(patch: Array, gu: Array, out: Array) -> None:
    """Write derivatives by shift and slopes (3, P), orthogonal to a constant and to the patch."""
    side = gu.shape[0]
    r = side // 2
    for j in range(side):
        for k in range(side):
            at = j * side + k
            out[0, at] = gu[j, k]
            out[1, at] = gu[j, k] * (k - r)
            out[2, at] = gu[j, k] * (j - r)
    flat = patch.ravel()
    for row in range(1, 3):
        slope = out[row]
        slope -= slope.mean()
        slope -= (slope * flat).sum() * flat
