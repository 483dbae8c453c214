"""Templates: patches extracted from an image once, to be aligned with many others."""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.sampling import GU, GV, INSIDE, PATCH, VECTOR, words, workspace

FLAT = 1e-3
"""Norm, grey levels, up to which a patch is flat."""


class Templates(NamedTuple):
    """Square patches of zero mean and unit norm, S samples a side.

    Attributes:
        patches: (N, S, S) float32; without meaning where the norm is zero.
        gradients: (N, 2, S, S) float32 derivatives of the normalised patch along u and v, per
            pixel; orthogonal to a constant and to the patch.
        norms: (N,) float32 norm of the centred patch in grey levels; zero where the patch left
            the image or is flat.
        noise_kept: (N,) float32 share of the variance of white pixel noise that interpolation
            between pixels left in the patch, 1 at whole pixels.
    """

    patches: Array
    gradients: Array
    norms: Array
    noise_kept: Array


def extract_templates(image: Image, pixels: Array, patch_px: int) -> Templates:
    """Extract patches of an odd side about sub-pixel centres (N, 2)."""
    n = len(pixels)
    templates = Templates(
        np.zeros((n, patch_px, patch_px), dtype=np.float32),
        np.zeros((n, 2, patch_px, patch_px), dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        np.ones(n, dtype=np.float32),
    )
    size = (int(image.shape[0]), int(image.shape[1]))
    _extract(words(image), size, np.ascontiguousarray(pixels, dtype=np.float64), templates)
    return templates


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _extract(grey: Array, size: tuple[int, int], pixels: Array, templates: Templates) -> None:
    patches, gradients, norms, kept = templates
    side = patches.shape[1]
    work, square = workspace(side), square_workspace(side, size[1])
    for i in range(len(pixels)):
        norms[i], kept[i] = extract_patch(grey, size, pixels[i, 0], pixels[i, 1], square, work)
        if norms[i] == 0:
            continue
        for j in range(side):
            for k in range(side):
                at = j * (side + 2) + k
                patches[i, j, k] = work[PATCH, at]
                gradients[i, 0, j, k], gradients[i, 1, j, k] = work[GU, at], work[GV, at]


@compiled()
def square_workspace(side: int, width: int) -> tuple[Array, Array, int]:
    """Allocate for the square of side S + 2 about a patch in an image of a width.

    Pixels (Q,) from its first one to each, and its grey levels (Q + ...,), rows one after the
    other; there is room for the neighbours of the samples of a workspace.
    """
    padded = side + 2
    count = (padded * padded + VECTOR - 1) // VECTOR * VECTOR
    places = np.zeros(count, dtype=np.int64)
    for j in range(padded):
        for k in range(padded):
            places[j * padded + k] = j * width + k
    return places, np.zeros(count + 3 * padded, dtype=np.float32), side


@compiled(fastmath={"reassoc", "contract"})
def extract_patch(
    grey: Array, size: tuple[int, int], u: float, v: float, square: tuple[Array, Array, int],
    work: Array,
) -> tuple[float, float]:  # fmt: skip
    """Write the patch about a pixel, normalised, and its gradients into a workspace.

    The norm, zero where there is no patch, and the share of noise kept are returned.
    """
    places, levels, side = square
    margin = side // 2 + 1
    height, width = size
    inside = u >= margin and u < width - 1 - margin and v >= margin and v < height - 1 - margin
    if not inside:  # also where a pixel is NaN
        return 0.0, 1.0
    first = (int(v) - margin) * width + int(u) - margin
    fu, fv = u - int(u), v - int(v)
    _sample_square(grey, first, width, (fu, fv), places, levels)
    norm = _differentiate(levels, side, work)
    return norm, (1 - 2 * fu * (1 - fu)) * (1 - 2 * fv * (1 - fv))


@compiled(fastmath={"reassoc", "contract"}, distinct=True)
def _sample_square(
    grey: Array, first: int, width: int, fraction: tuple[float, float], places: Array, levels: Array
) -> None:
    """Sample a unit grid bilinearly: its weights are the same everywhere."""
    fu, fv = np.float32(fraction[0]), np.float32(fraction[1])
    below, byte = np.uint64(width - 2), np.uint32(255)
    for k in range(np.uint64(places.shape[0])):
        at = np.uint64(first + places[k])
        upper, lower = grey[at], grey[at + below]
        a = np.float32(np.int32(upper & byte))
        b = np.float32(np.int32((upper >> np.uint32(8)) & byte))
        c = np.float32(np.int32((lower >> np.uint32(16)) & byte))
        d = np.float32(np.int32(lower >> np.uint32(24)))
        top, bottom = a + (b - a) * fu, c + (d - c) * fu
        levels[k] = top + (bottom - top) * fv


@compiled(fastmath={"reassoc", "contract"}, distinct=True)
def _differentiate(levels: Array, side: int, work: Array) -> float:
    """Normalise the inner part of a square and its central differences; return the norm.

    The derivative of the normalised patch is the gradient without its parts along the constant
    and along the patch itself.
    """
    stride, count = np.uint64(side + 2), np.float32(side * side)
    one, two, half = np.uint64(1), np.uint64(2), np.float32(0.5)
    samples = np.uint64(work.shape[1])
    mean = mean_u = mean_v = np.float32(0)
    for k in range(samples):
        inside = work[INSIDE, k]
        level = levels[k + stride + one] * inside
        du = (levels[k + stride + two] - levels[k + stride]) * half * inside
        dv = (levels[k + stride + stride + one] - levels[k + one]) * half * inside
        work[PATCH, k], work[GU, k], work[GV, k] = level, du, dv
        mean += level
        mean_u += du
        mean_v += dv
    mean, mean_u, mean_v = mean / count, mean_u / count, mean_v / count
    squares = along_u = along_v = np.float32(0)
    for k in range(samples):
        inside = work[INSIDE, k]
        level = work[PATCH, k] - mean * inside
        du, dv = work[GU, k] - mean_u * inside, work[GV, k] - mean_v * inside
        work[PATCH, k], work[GU, k], work[GV, k] = level, du, dv
        squares += level * level
        along_u += level * du
        along_v += level * dv
    norm = np.sqrt(squares)
    if not norm > FLAT:
        return 0.0
    scale = np.float32(1) / norm
    along_u, along_v = along_u * scale * scale, along_v * scale * scale
    for k in range(samples):
        level = work[PATCH, k]
        work[PATCH, k] = level * scale
        work[GU, k] = (work[GU, k] - along_u * level) * scale
        work[GV, k] = (work[GV, k] - along_v * level) * scale
    return float(norm)
