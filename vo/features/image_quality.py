"""What an image is made of: noise, texture over it, and how fine this is.

Source: Immerkær, Fast noise variance estimation, CVIU 1996, here by blocks, of which the calmest
tell the noise.
"""

from dataclasses import dataclass

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

BLOCK_PX = 16
CALM = 0.1
"""Share of the blocks that are taken to show nothing but noise."""

LEAST_NOISE = 0.3
"""Grey levels: what rounding alone amounts to."""

NEAR_PX, FAR_PX = 2, 4
"""Distances over which differences tell how fine texture is."""

ROWS_APART = 8
LEAST_SIGNAL = 0.25
"""Share of a difference's energy that is never put down to noise."""


@dataclass(frozen=True)
class ImageQuality:
    """What an image is made of.

    Attributes:
        noise: Standard deviation, grey levels.
        texture_to_noise: Median over blocks of the energy of texture over that of noise; infinite
            without a block.
        softness: Energy of differences over FAR_PX to that over NEAR_PX, along rows or columns,
            whichever is less: 4, the square of the distances, where all is smooth, 1 to 2.5 where
            it is sharp. Motion blurs one direction, a lens out of focus both.
    """

    noise: float
    texture_to_noise: float
    softness: float


def measure_image_quality(image: Image) -> ImageQuality:
    """Measure an image (H, W) uint8."""
    found = _blocks(image)
    if not len(found):
        return ImageQuality(0.0, np.inf, 1.0)
    noise = max(float(np.quantile(found[:, 0], CALM)), LEAST_NOISE)
    texture_to_noise = max(float(np.median(found[:, 1])) / noise**2 - 1, 0.0)
    softness = min(
        _smoothness(lines, noise) for lines in (image[::ROWS_APART], image.T[::ROWS_APART])
    )
    return ImageQuality(noise, texture_to_noise, softness)


def _smoothness(lines: Image, noise: float) -> float:
    """Energy of differences over FAR_PX to that over NEAR_PX along lines (N, L)."""
    near, far = (
        float(np.mean((lines[:, apart:].astype(np.int32) - lines[:, :-apart]) ** 2))
        for apart in (NEAR_PX, FAR_PX)
    )
    least = max(LEAST_SIGNAL * near, LEAST_NOISE**2)
    return max(far - 2 * noise**2, least) / max(near - 2 * noise**2, least)


@compiled()
def _blocks(image: Image) -> Array:
    """Noise in grey levels, and variance, of every other block each way: (B, 2)."""
    rows, columns = (image.shape[0] - 2) // BLOCK_PX, (image.shape[1] - 2) // BLOCK_PX
    count = BLOCK_PX * BLOCK_PX
    found = np.empty(((rows + 1) // 2 * ((columns + 1) // 2), 2))
    block = 0
    for row in range(0, rows, 2):
        for column in range(0, columns, 2):
            curved = total = squares = 0
            for v in range(1 + row * BLOCK_PX, 1 + (row + 1) * BLOCK_PX):
                above, here, below = image[v - 1], image[v], image[v + 1]
                for u in range(1 + column * BLOCK_PX, 1 + (column + 1) * BLOCK_PX):
                    x = np.int64(here[u])
                    corners = np.int64(above[u - 1]) + above[u + 1] + below[u - 1] + below[u + 1]
                    sides = np.int64(above[u]) + below[u] + here[u - 1] + here[u + 1]
                    curved += abs(corners - 2 * sides + 4 * x)
                    total += x
                    squares += x * x
            found[block, 0] = np.sqrt(np.pi / 2) / 6 * curved / count
            found[block, 1] = squares / count - (total / count) ** 2
            block += 1
    return found
