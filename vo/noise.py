"""How the texture of an image compares with its noise, and what faint images are met with.

Where noise is as strong as texture, a patch of the usual size says little: windows grow until they
hold enough (Kanade and Okutomi, PAMI 1994). The size is one for the whole image.

Source: Immerkær, Fast noise variance estimation, CVIU 1996, here by blocks, of which the calmest
tell the noise.
"""

from dataclasses import dataclass

import numba
import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Image

BLOCK_PX = 16
CALM = 0.1
"""Share of the blocks that are taken to show nothing but noise."""

LEAST_NOISE = 0.3
"""Grey levels: what rounding alone amounts to."""

WIDEST_PX = 31


@dataclass(frozen=True)
class Grain:
    """What an image is made of.

    Attributes:
        noise: Standard deviation, grey levels.
        texture_to_noise: Median over blocks of the energy of texture over that of noise; infinite
            without a block.
    """

    noise: float
    texture_to_noise: float


def grain(image: Image) -> Grain:
    """Measure an image (H, W) uint8."""
    found = _blocks(image)
    if not len(found):
        return Grain(0.0, np.inf)
    noise = max(float(np.quantile(found[:, 0], CALM)), LEAST_NOISE)
    return Grain(noise, max(float(np.median(found[:, 1])) / noise**2 - 1, 0.0))


def widened(settings: OdometrySettings) -> OdometrySettings:
    """Return the settings for faint images: wide windows, and less exact disparities."""
    faint, matching, stereo = settings.faint, settings.matching, settings.stereo

    def wide(side_px: int, growth: float = faint.window_growth) -> int:
        return min(2 * int(side_px * growth / 2) + 1, WIDEST_PX)

    matching = matching.model_copy(update={"align_px": wide(matching.align_px)})
    stereo = stereo.model_copy(
        update={
            "search_px": wide(stereo.search_px, faint.search_growth),
            "align_px": wide(stereo.align_px),
            "most_sigma_px": faint.sigma_growth * stereo.most_sigma_px,
        }
    )
    return settings.model_copy(update={"matching": matching, "stereo": stereo})


@numba.njit(cache=True)
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
