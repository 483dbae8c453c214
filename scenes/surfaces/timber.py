"""Wood and painted metal."""

import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, smoothstep, to_image
from vo.contract.arrays import Image


def wood(rng: np.random.Generator, shape: Shape, rgb: Rgb) -> Image:
    """Draw planed wood with the grain along u: (H, W, 3), tiling."""
    drift = fractal(rng, shape, (60, 1200), 1.6, stretch=6.0)
    rings = np.sin(9 * drift + 2.5 * fractal(rng, shape, (8, 400), 1.2, stretch=12.0))
    pores = fractal(rng, shape, (2, 12), 0.3, stretch=9.0)
    colour = np.asarray(rgb) * (1 + 0.07 * rings + 0.04 * drift)[..., None]
    return to_image(blend(colour, np.asarray(rgb) * 0.55, 0.6 * smoothstep(1.2, 2.4, pores)))


def painted(rng: np.random.Generator, shape: Shape, rgb: Rgb) -> Image:
    """Draw painted or powder-coated metal with dust and scratches: (H, W, 3), tiling."""
    dust = fractal(rng, shape, (2, 300), 1.1)
    scratches = fractal(rng, shape, (2, 20), 0.3, stretch=14.0)
    colour = np.asarray(rgb) * (1 + 0.035 * dust)[..., None]
    colour = blend(colour, np.asarray(rgb) * 0.6 + 70, 0.5 * smoothstep(2.2, 3.2, scratches))
    return to_image(colour)


def slotted(rng: np.random.Generator, shape: Shape, rgb: Rgb) -> Image:
    """Draw the painted post of a rack with two rows of slots, 50 mm apart on a metre: (H, W, 3)."""
    v, u = np.mgrid[: shape[0], : shape[1]] / np.array(shape).reshape(2, 1, 1)
    slot = (np.abs(v * 20 % 1 - 0.5) < 0.28) & (np.abs(np.abs(u - 0.5) - 0.22) < 0.07)
    return to_image(blend(painted(rng, shape, rgb).astype(np.float32), (34, 36, 40), 0.85 * slot))
