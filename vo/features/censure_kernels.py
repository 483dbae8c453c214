"""Centre-surround kernels: box, octagon and star at seven sizes, as signed octagons.

Source: Agrawal, Konolige and Blas, CenSurE, ECCV 2008, sections 3.1 (boxes) and 3.2 (octagons,
table 1). The star, two squares of which one is turned by 45 degrees, is the shape that Konolige's
later detector of the same family uses; here it is flat, its core not counted twice.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array
from vo.features.integral_images import MAX_REACH, boundary

Region = tuple[tuple[int, int, int], ...]
"""Region as (sign, m, n) of the octagons that add up to it, all centred on the same pixel."""


def _octagon(m: int, n: int) -> Region:
    return ((1, m, n),)


def _box(half: int) -> Region:
    return _octagon(2 * half + 1, 0)


def _star(half: int) -> Region:
    """Union of a square and a diamond: their sum less the octagon that they share."""
    tip = half + (half + 1) // 2
    return (1, 2 * half + 1, 0), (1, 1, tip), (-1, 2 * (tip - half) + 1, 2 * half - tip)


_OCTAGONS = (
    ((3, 0), (5, 2)),
    ((3, 1), (5, 3)),
    ((3, 2), (7, 3)),
    ((5, 2), (9, 4)),
    ((5, 3), (9, 7)),
    ((7, 3), (13, 7)),
    ((9, 4), (15, 10)),
)

SHAPES: dict[str, tuple[tuple[Region, Region], ...]] = {
    "box": tuple((_box(n), _box(2 * n)) for n in range(1, 8)),
    "octagon": tuple((_octagon(*inner), _octagon(*outer)) for inner, outer in _OCTAGONS),
    "star": tuple((_star(n), _star(2 * n)) for n in range(1, 8)),
}
"""Centre, and centre with surround, of each kernel shape from the smallest scale to the largest."""


class Kernels(NamedTuple):
    """Kernels of S scales over R distinct regions, as tables for the inner loops.

    The sizes of table 1 grow unevenly: the ratio of surround to centre falls from 2.8 to 2 in
    radius, and the response to a blob with it. Without the gain the smallest kernel responds most
    too often; on photographs that costs up to 7 % of repeatability when the view changes.

    Attributes:
        pieces: (P, 2) int64, rows (region, sign) of the octagons that make up the regions.
        corners: (P, 8, 3) int64, the boundary of each octagon (`integral_images.boundary`).
        regions: (S, 2) int64, the centre and the whole of each scale.
        weights: (S, 2) float32 factors of the sums over the two regions. They give the mean of
            the centre minus that of the surround, times a gain with which the largest response
            to a Gaussian blob is the blob's contrast.
        margin: (S,) int64 half width of each whole, pixels, never falling.
        window_px: (S,) int64 half side of the square in which a corner has gradients of both
            directions: the radius of the disc that has the centre's area, and two more.
    """

    pieces: Array
    corners: Array
    regions: Array
    weights: Array
    margin: Array
    window_px: Array


@cache
def kernels(shape: str) -> Kernels:
    """Build the kernels of a shape, sharing the regions that repeat."""
    pairs = SHAPES[shape]
    distinct = list(dict.fromkeys(region for pair in pairs for region in pair))
    reach = np.array([max((m - 1) // 2 + n for _, m, n in region) for region in distinct])
    regions = np.array([[distinct.index(region) for region in pair] for pair in pairs])
    y, x = np.abs(np.mgrid[-MAX_REACH : MAX_REACH + 1, -MAX_REACH : MAX_REACH + 1])
    masks = np.array([_mask(region, x, y).ravel() for region in distinct])
    area = masks.sum(axis=1)
    centre, whole = area[regions].T
    ring = whole - centre
    means = np.stack([1 / centre + 1 / ring, -1 / ring], axis=-1)

    sigma_px = np.geomspace(0.5, 20, 400)
    blobs = np.exp((x**2 + y**2).reshape(-1, 1) / (-2 * sigma_px**2))  # of contrast 1
    to_blobs = (means[:, :, None] * (masks @ blobs)[regions]).sum(axis=1)
    gain = 1 / to_blobs.max(axis=1, keepdims=True)
    pieces = [(i, *piece) for i, region in enumerate(distinct) for piece in region]
    return Kernels(
        pieces=np.array([piece[:2] for piece in pieces]),
        corners=np.array([boundary(m, n) for _, _, m, n in pieces]),
        regions=regions,
        weights=(gain * means).astype(np.float32),
        margin=reach[regions[:, 1]],
        window_px=np.round(np.sqrt(centre / np.pi)).astype(np.int64) + 2,
    )


def _mask(region: Region, x: Array, y: Array) -> Array:
    """Mark with 1, else 0, the distances (x, y) from the centre that lie in a region."""
    inside = [
        sign * ((np.maximum(x, y) <= m // 2 + n) & (x + y <= m - 1 + n)) for sign, m, n in region
    ]
    return np.sum(inside, axis=0)
