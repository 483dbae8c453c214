"""Loose sand: its relief, its colour, and its shading under a low sun, which shows the relief."""

from collections.abc import Sequence

import numpy as np

from scenes.surfaces import Shape
from scenes.surfaces.noise import blend, fractal, ramp, smoothstep
from vo.contract.arrays import Array

RIPPLE_M = (0.07, 0.11)
"""Distances between the crests that wind leaves."""
TONES = ((138, 116, 90), (170, 146, 116), (198, 176, 144))


def relief(rng: np.random.Generator, shape: Shape, texel_m: float) -> Array:
    """Draw heights in metres of ripples along u, lumps and footmarks: (H, W), tiling."""
    near, far = (length / texel_m for length in RIPPLE_M)
    ripples = fractal(rng, shape, (near, far), 0.0, stretch=3.5)
    here = smoothstep(-0.8, 0.8, fractal(rng, shape, (0.5 / texel_m, max(shape)), 1.0))
    lumps = fractal(rng, shape, (0.035 / texel_m, 0.6 / texel_m), 1.4)
    clods = fractal(rng, shape, (0.008 / texel_m, 0.05 / texel_m), 0.6)
    return 0.0011 * here * ripples + 0.0022 * lumps + 0.00014 * clods


def grains(rng: np.random.Generator, shape: Shape) -> Array:
    """Draw the colours of dry sand with dark minerals in level light: (H, W, 3) float, tiling."""
    cloud = fractal(rng, shape, (40, max(shape)), 1.2)
    grain = fractal(rng, shape, (1.4, 5), 0.1)
    colour = ramp(TONES, 0.5 + 0.10 * cloud + 0.10 * grain)
    minerals = fractal(rng, shape, (2.0, 6.0), 0.0)
    return blend(colour, (92, 78, 64), 0.6 * smoothstep(2.0, 2.9, minerals))


def shaded(colour: Array, rise: tuple[Array, Array], key: Array, lamps: Sequence[Array]) -> Array:
    """Shade a relief relative to level ground.

    Args:
        colour: (H, W, 3) in level light, 0 to 255.
        rise: Slopes dz/dx and dz/dy (H, W) in world axes.
        key: (3,) unit vector towards the key lamp, world.
        lamps: Colours (3,) of the key lamp at full incidence and of all other light.

    Returns:
        (H, W, 3) colours.
    """
    x, y = rise
    towards, direct, other = (v.astype(np.float32) for v in (key, *lamps))
    facing = np.maximum(towards[2] - towards[0] * x - towards[1] * y, 0)
    facing /= np.sqrt(1 + x * x + y * y)
    level = direct * towards[2] + other
    return colour * (other / level + facing[..., None] * (direct / level))
