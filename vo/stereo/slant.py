"""Slant of the surface at a feature, from the intensities of its two images.

The aligner's Gauss–Newton with three unknowns: the disparity and its slopes along u and v. It needs
no neighbours, but is several times noisier than a plane through the disparities of many.

Source: Devernay and Faugeras, Computing Differential Properties of 3-D Shapes from Stereoscopic
Images without 3-D Models, CVPR 1994; inverse compositional as in `vo.patches.alignment`.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.alignment import MIN_NORM
from vo.patches.sampling import (
    GU,
    GV,
    PATCH,
    correlate,
    is_inside,
    words,
    workspace,
    write_offsets,
)  # fmt: skip
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
    size = (int(right.shape[0]), int(right.shape[1]))
    start = np.ascontiguousarray(pixels_right, dtype=np.float64)
    return _fit_all(templates, words(right), size, start)


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _fit_all(templates: Templates, right: Array, size: tuple[int, int], start: Array) -> Array:
    patches, gradients, norms, _ = templates
    slopes = np.full((len(norms), 2), np.nan)
    side = patches.shape[1]
    r = side // 2
    work = workspace(side)
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
        for j in range(side):
            for k in range(side):
                at = j * (side + 2) + k
                work[PATCH, at], work[GU, at], work[GV, at] = jacobian[:, j * side + k]
        u, v = start[i]
        warp[0, 0], warp[0, 1] = 1.0, 0.0
        for _ in range(MAX_STEPS):
            if not is_inside(u, v, write_offsets(warp, side, work), size):
                break
            norm, by_shift, by_u, by_v = correlate(right, size[1], u, v, side, work)
            if not norm > MIN_NORM:
                break
            # The increment, a map of the row u -> p0 + (1 + p1) u + p2 v, is undone.
            p = inverse @ np.array([by_shift, by_u, by_v], dtype=np.float32) / norm
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
