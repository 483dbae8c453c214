"""Bilinear samples of a patch, compared with a template in the same loop.

A patch of an odd side S has S rows of S + 2 samples: neighbours, also those a row apart, are then
at one distance everywhere, and whole vectors of samples are computed at once. Samples beyond column
S - 1 count nothing, as their weight `INSIDE` says. The four pixels about a sample are in two words
of four bytes: two loads instead of four.
"""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

X, Y, INSIDE, PATCH, GU, GV, U, V = range(8)
"""Rows of a workspace (8, P): a sample's column and row about the centre, its weight, 0 or 1, the
template's normalised grey level and derivatives along u and v, and its offset in the image."""

ROUNDING_PX = 1e-3
"""Largest error of a sample's position in single precision."""

VECTOR = 8
"""Samples that are computed at once."""


def words(image: Image) -> Array:
    """View an image (H, W) as words (H W - 3,) of four bytes, which begin at each pixel.

    The pixel itself is in the lowest byte. The image's rows lie one after the other.
    """
    return np.ndarray((image.size - 3,), np.dtype("<u4"), np.ascontiguousarray(image), strides=(1,))


@compiled()
def workspace(side: int) -> Array:
    """Allocate a workspace (8, P), float32, for patches of an odd side."""
    stride = side + 2
    work = np.zeros((8, (side * stride + VECTOR - 1) // VECTOR * VECTOR), dtype=np.float32)
    for j in range(side):
        for k in range(side):
            at = j * stride + k
            work[X, at], work[Y, at], work[INSIDE, at] = k - side // 2, j - side // 2, 1
    return work


@compiled(fastmath={"reassoc", "contract"})
def write_offsets(warp: Array, side: int, work: Array) -> tuple[float, float]:
    """Write the offsets of the template's samples from its centre in the image, by a warp (3, 2).

    Return their largest sizes along u and v; NaN if the surface is seen almost edge-on.
    """
    r = side // 2
    a, b, c, d, e, f = warp[0, 0], warp[0, 1], warp[1, 0], warp[1, 1], warp[2, 0], warp[2, 1]
    shrink = 1 - r * (abs(e) + abs(f))
    if not shrink > 0.5:  # also where the warp is NaN
        return np.nan, np.nan
    reach_u, reach_v = r * (abs(a) + abs(b)) / shrink, r * (abs(c) + abs(d)) / shrink
    a, b, c = np.float32(a), np.float32(b), np.float32(c)
    d, e, f = np.float32(d), np.float32(e), np.float32(f)
    for k in range(np.uint64(work.shape[1])):
        x, y = work[X, k], work[Y, k]
        scale = np.float32(1) / (np.float32(1) + e * x + f * y)
        work[U, k] = scale * (a * x + b * y)
        work[V, k] = scale * (c * x + d * y)
    return reach_u, reach_v


@compiled()
def is_inside(u: float, v: float, reach: tuple[float, float], size: tuple[int, int]) -> bool:
    """Whether all samples about (u, v) lie in an image of a height and width; False for NaN."""
    across = u - reach[0] >= 0 and u + reach[0] < size[1] - 1 - ROUNDING_PX
    return across and v - reach[1] >= 0 and v + reach[1] < size[0] - 1 - ROUNDING_PX


@compiled(fastmath={"reassoc", "contract"})
def correlate(
    grey: Array, width: int, u: float, v: float, side: int, work: Array
) -> tuple[float, float, float, float]:
    """Sample an image, given as words, at (u, v) + the offsets, all inside of it.

    Return the norm of the grey levels about their mean, and their products with the template's
    patch and derivatives. These sum to zero: a constant in the grey levels changes nothing.
    """
    u0, v0 = int(u), int(v)
    fu, fv = np.float32(u - u0), np.float32(v - v0)
    origin = v0 * width + u0
    wide, byte, below = np.float32(width), np.uint32(255), np.uint64(width - 2)
    pivot = np.float32(np.int64(grey[np.uint64(origin)] & byte))
    total = squares = by_patch = by_u = by_v = np.float32(0)
    for k in range(np.uint64(work.shape[1])):
        x, y = fu + work[U, k], fv + work[V, k]
        x_floor, y_floor = np.floor(x), np.floor(y)
        fx, fy = x - x_floor, y - y_floor
        at = np.uint64(origin + np.int32(y_floor * wide + x_floor))
        upper, lower = grey[at], grey[at + below]  # the last word of an image ends with it
        a = np.float32(np.int32(upper & byte))
        b = np.float32(np.int32((upper >> np.uint32(8)) & byte))
        c = np.float32(np.int32((lower >> np.uint32(16)) & byte))
        d = np.float32(np.int32(lower >> np.uint32(24)))
        top, bottom = a + (b - a) * fx, c + (d - c) * fx
        level = (top + (bottom - top) * fy - pivot) * work[INSIDE, k]
        total += level
        squares += level * level
        by_patch += level * work[PATCH, k]
        by_u += level * work[GU, k]
        by_v += level * work[GV, k]
    square = squares - total * total / np.float32(side * side)
    norm = np.sqrt(max(square, np.float32(0)))
    return float(norm), float(by_patch), float(by_u), float(by_v)


@compiled(fastmath={"reassoc", "contract"})
def noise_kept(u: float, v: float, side: int, work: Array) -> float:
    """Share of the variance of white pixel noise that interpolation leaves, 1 at whole pixels."""
    fu, fv = np.float32(u - np.floor(u)), np.float32(v - np.floor(v))
    one, two = np.float32(1), np.float32(2)
    kept = np.float32(0)
    for k in range(np.uint64(work.shape[1])):
        x, y = fu + work[U, k], fv + work[V, k]
        fx, fy = x - np.floor(x), y - np.floor(y)
        kept += work[INSIDE, k] * (one - two * fx * (one - fx)) * (one - two * fy * (one - fy))
    return float(kept) / (side * side)
