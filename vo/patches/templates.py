"""Templates: patches extracted from an image once, to be aligned with many others."""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

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


class PatchWorkspace(NamedTuple):
    """Arrays for one patch of side S after the other: float32.

    The padded patch (S + 2, S + 2), the patch (S, S), its gradients (2, S, S), offsets (2, S * S)
    and grey levels (S * S,) of its samples in another image.
    """

    padded: Array
    patch: Array
    gradients: Array
    offsets: Array
    now: Array


@compiled()
def patch_workspace(side: int) -> PatchWorkspace:
    """Allocate a workspace."""
    return PatchWorkspace(
        np.empty((side + 2, side + 2), dtype=np.float32),
        np.empty((side, side), dtype=np.float32),
        np.empty((2, side, side), dtype=np.float32),
        np.empty((2, side * side), dtype=np.float32),
        np.empty(side * side, dtype=np.float32),
    )


def extract_templates(image: Image, pixels: Array, patch_px: int) -> Templates:
    """Extract patches of an odd side about sub-pixel centres (N, 2)."""
    n = len(pixels)
    templates = Templates(
        np.zeros((n, patch_px, patch_px), dtype=np.float32),
        np.zeros((n, 2, patch_px, patch_px), dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        np.ones(n, dtype=np.float32),
    )
    _extract(image, np.ascontiguousarray(pixels, dtype=np.float64), templates)
    return templates


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _extract(image: Image, pixels: Array, templates: Templates) -> None:
    patches, gradients, norms, noise_kept = templates
    side = patches.shape[1]
    padded = np.empty((side + 2, side + 2), dtype=np.float32)
    for i in range(len(pixels)):
        u, v = pixels[i]
        norms[i], noise_kept[i] = extract_patch(image, u, v, padded, patches[i], gradients[i])


@compiled(fastmath={"reassoc", "contract"})
def extract_patch(
    image: Image, u: float, v: float, padded: Array, patch: Array, gradients: Array
) -> tuple[float, float]:
    """Write the patch (S, S) about a pixel and its gradients (2, S, S), as in `Templates`.

    The norm, zero where there is no patch, and the share of noise kept are returned; the work
    array is (S + 2, S + 2).
    """
    margin = patch.shape[0] // 2 + 1
    height, width = image.shape
    inside = u >= margin and u < width - 1 - margin and v >= margin and v < height - 1 - margin
    if not inside:  # also where a pixel is NaN
        return 0.0, 1.0
    _sample_square(image, u, v, padded)
    fu, fv = u - np.floor(u), v - np.floor(v)
    norm = _differentiate(padded, patch, gradients[0], gradients[1])
    return norm, (1 - 2 * fu * (1 - fu)) * (1 - 2 * fv * (1 - fv))


@compiled(fastmath={"reassoc", "contract"})
def _sample_square(image: Image, u: float, v: float, out: Array) -> None:
    """Sample a unit grid about (u, v) bilinearly: its weights are the same everywhere."""
    side = out.shape[0]
    u0, v0 = int(u) - side // 2, int(v) - side // 2
    fu, fv = np.float32(u - int(u)), np.float32(v - int(v))
    one = np.float32(1)
    w00, w01 = (one - fv) * (one - fu), (one - fv) * fu
    w10, w11 = fv * (one - fu), fv * fu
    for j in range(side):
        above, below = image[v0 + j], image[v0 + j + 1]
        for k in range(side):
            x = u0 + k
            out[j, k] = w00 * above[x] + w01 * above[x + 1] + w10 * below[x] + w11 * below[x + 1]


@compiled(fastmath={"reassoc", "contract"})
def _differentiate(padded: Array, patch: Array, gu: Array, gv: Array) -> float:
    """Normalise the inner part of a padded patch and its central differences; return the norm.

    The derivative of the normalised patch is the gradient without its parts along the constant
    and along the patch itself.
    """
    side = patch.shape[0]
    half, count = np.float32(0.5), np.float32(side * side)
    mean = mean_u = mean_v = np.float32(0)
    for j in range(side):
        for k in range(side):
            patch[j, k] = padded[j + 1, k + 1]
            gu[j, k] = (padded[j + 1, k + 2] - padded[j + 1, k]) * half
            gv[j, k] = (padded[j + 2, k + 1] - padded[j, k + 1]) * half
            mean += patch[j, k]
            mean_u += gu[j, k]
            mean_v += gv[j, k]
    mean, mean_u, mean_v = mean / count, mean_u / count, mean_v / count
    squares = np.float32(0)
    for j in range(side):
        for k in range(side):
            patch[j, k] -= mean
            squares += patch[j, k] * patch[j, k]
    norm = np.sqrt(squares)
    if not norm > FLAT:
        return 0.0
    along_u = along_v = np.float32(0)
    for j in range(side):
        for k in range(side):
            patch[j, k] /= norm
            gu[j, k] = (gu[j, k] - mean_u) / norm
            gv[j, k] = (gv[j, k] - mean_v) / norm
            along_u += gu[j, k] * patch[j, k]
            along_v += gv[j, k] * patch[j, k]
    for j in range(side):
        for k in range(side):
            gu[j, k] -= along_u * patch[j, k]
            gv[j, k] -= along_v * patch[j, k]
    return norm
