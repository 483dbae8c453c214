"""Lawn, leaves, soil and bark."""

import numpy as np

from scenes.surfaces.noise import blend, fractal, ramp, smoothstep, to_image
from vo.contract.arrays import Array, Image


def lawn(rng: np.random.Generator, side_px: int, patchy: float = 1.0) -> Image:
    """Draw short grass from above: (S, S, 3), tiling; `patchy` is the strength of dry patches."""
    size = (side_px, side_px)
    blades = _crossed(rng, side_px, (2, 20), 0.2, 5.0)
    clumps = fractal(rng, size, (12, 90), 0.6)
    patches = fractal(rng, size, (60, side_px), 1.4)
    tones = ((38, 44, 24), (70, 82, 44), (100, 112, 64), (140, 146, 92))
    colour = ramp(tones, 0.30 + 0.24 * blades + 0.08 * clumps)
    colour = blend(colour, (128, 116, 74), 0.5 * patchy * smoothstep(0.4, 2.0, patches))
    return to_image(colour * (1 + 0.06 * patchy * patches)[..., None])


def mown(rng: np.random.Generator, side_px: int) -> Image:
    """Draw trodden, freshly mown grass with dry clippings and a little earth: (S, S, 3), tiling.

    Nothing in it is larger than a few centimetres at 1 mm per texel.
    """
    size = (side_px, side_px)
    blades = _crossed(rng, side_px, (2, 16), 0.2, 4.0)
    clumps = fractal(rng, size, (10, 60), 0.4)
    colour = grass_tones(0.34 + 0.24 * blades + 0.11 * clumps).astype(np.float32)
    straw = _crossed(rng, side_px, (3, 14), 0.0, 7.0)
    colour = blend(colour, (196, 182, 132), 0.85 * smoothstep(1.7, 2.3, straw))
    earth = smoothstep(1.0, 1.9, fractal(rng, size, (4, 60), 0.5))
    return to_image(blend(colour, (104, 88, 66), 0.8 * earth))


def _crossed(
    rng: np.random.Generator, side_px: int, band: tuple[float, float], slope: float, stretch: float
) -> Array:
    """Draw noise in a band of wavelengths, its features along either axis: (S, S)."""
    along, across = (fractal(rng, (side_px, side_px), band, slope, stretch) for _ in range(2))
    return np.maximum(along, across.T)


def foliage(rng: np.random.Generator, side_px: int, haze: float) -> Image:
    """Draw the leaves of a tree in the sun, far enough for some haze: (S, S, 3), tiling."""
    near = leaves(rng, 1, side_px)[0] * np.array([1.25, 1.3, 1.1]) + (18, 22, 8)
    return to_image(near + haze * (np.array([176, 190, 178]) - near))


def grass_tones(values: Array) -> Image:
    """Colour (H, W) values in [0, 1] as grass, deep green to straw: (H, W, 3)."""
    stops = ((34, 42, 20), (66, 84, 38), (98, 116, 56), (138, 146, 82), (184, 172, 122))
    return to_image(ramp(stops, values))


def leaves(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw dense foliage, dark in its depth: (count, S, S, 3), each tiling."""
    size = (count, side_px, side_px)
    height = np.full(size, -9.0, dtype=np.float32)
    tone = np.zeros(size, dtype=np.float32)
    for layer in range(4):
        stretch = 2.2 if layer % 2 else 0.6
        bump = fractal(rng, size, (8, 34), 0.4, stretch=stretch) + 0.35 * layer
        shade = fractal(rng, size, (8, 60), 0.8)
        tone = np.where(bump > height, shade, tone)
        height = np.maximum(height, bump)
    tones = ((18, 26, 12), (52, 72, 34), (88, 112, 54), (136, 156, 86))
    return to_image(ramp(tones, 0.12 + 0.22 * height + 0.10 * tone))


def fallen_leaves(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw dry leaf blades with midrib and veins along u: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    v, u = np.mgrid[:side_px, :side_px] / (side_px - 1) - 0.5
    palette = ((88, 68, 52), (118, 92, 66), (140, 118, 84), (110, 104, 76))
    tone = rng.uniform(0, 1, (count, 1, 1))
    colour = ramp(palette, tone + 0.12 * fractal(rng, size, (4, side_px), 1.2))
    ribs = np.abs(np.sin(26 * (u - 0.9 * np.abs(v)))) < 0.14
    midrib = np.abs(v) < 0.018
    return to_image(blend(colour, (70, 48, 30), 0.5 * (ribs | midrib) * np.ones(size)))


def soil(rng: np.random.Generator, side_px: int) -> Image:
    """Draw dark planting soil with chips of bark: (S, S, 3), tiling."""
    size = (side_px, side_px)
    clods = fractal(rng, size, (2, 60), 0.7)
    chips = fractal(rng, size, (4, 30), 0.3, stretch=3.0)
    colour = ramp(((26, 20, 16), (58, 44, 34), (88, 70, 54)), 0.45 + 0.2 * clods)
    return to_image(blend(colour, (118, 90, 66), 0.7 * smoothstep(1.2, 2.0, chips)))
