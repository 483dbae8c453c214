"""What indoor and outdoor floors are covered with, at about 1 mm per texel."""

import numpy as np

from scenes.surfaces.noise import blend, fractal, smoothstep, to_image
from vo.contract.arrays import Image


def linoleum(rng: np.random.Generator, side_px: int, rgb: tuple[float, float, float]) -> Image:
    """Draw plain sheet flooring, faintly mottled, with a few heel marks: (S, S, 3), tiling."""
    size = (side_px, side_px)
    mottle = fractal(rng, size, (4, 60), 0.8)
    chips = fractal(rng, size, (2.5, 9), 0.0)
    colour = np.asarray(rgb) * (1 + 0.013 * mottle)[..., None]
    colour = blend(colour, np.asarray(rgb) * 0.80, 0.7 * smoothstep(1.7, 2.6, chips))
    colour = blend(colour, np.asarray(rgb) * 1.14, 0.7 * smoothstep(1.7, 2.6, -chips))
    heels = fractal(rng, size, (5, 40), 0.4, stretch=5.0)
    return to_image(blend(colour, (54, 52, 50), 0.5 * smoothstep(3.7, 4.4, heels)))
