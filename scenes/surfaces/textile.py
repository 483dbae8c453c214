"""Carpet tiles and upholstery."""

import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, ramp, rim, smoothstep, to_image
from vo.contract.arrays import Image

CARPETS = (  # dark, middle, light yarn
    ((66, 70, 78), (122, 127, 136), (186, 191, 198)),
    ((76, 70, 64), (136, 127, 117), (194, 186, 174)),
    ((68, 74, 74), (122, 130, 128), (182, 190, 186)),
)


def carpet_tiles(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw worn loop-pile tiles of one range at 1 mm per texel: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    yarn = CARPETS[rng.integers(len(CARPETS))]
    loops = fractal(rng, size, (2.2, 7), 0.0)
    heather = fractal(rng, size, (6, 50), 0.5, stretch=2.5)
    tread = fractal(rng, size, (24, 300), 0.9)
    batch = rng.normal(0, 0.04, (count, 1, 1))
    colour = ramp(yarn, 0.48 + 0.15 * loops + 0.12 * heather + 0.055 * tread + batch)
    fleck = fractal(rng, size, (3, 12), 0.0, stretch=1.8)
    accent = np.array(((176, 120, 70), (88, 122, 150), (190, 184, 172)))[rng.integers(3)]
    colour = blend(colour, accent, 0.6 * smoothstep(1.9, 2.7, fleck))
    colour = blend(colour, np.array(yarn[0]) * 0.7, 0.7 * smoothstep(1.8, 2.6, -fleck))
    spill = fractal(rng, size, (10, 200), 1.5) + 0.25 * rng.standard_normal((count, 1, 1))
    colour = blend(colour, (66, 56, 46), 0.3 * smoothstep(2.1, 3.0, spill))
    seam = 1 - 0.28 * smoothstep(3.5, 0.5, rim((side_px, side_px)) + 0.8 * loops)
    return to_image(colour * seam[..., None])


def fabric(rng: np.random.Generator, side_px: int, rgb: Rgb) -> Image:
    """Draw a coarse weave: (S, S, 3), tiling when S is a multiple of 8."""
    v, u = np.mgrid[:side_px, :side_px]
    weave = np.sin(u * np.pi / 2) * np.sin(v * np.pi / 2)
    yarn = fractal(rng, (side_px, side_px), (2, 30), 0.4, stretch=3.0)
    wear = fractal(rng, (side_px, side_px), (30, side_px), 1.4)
    tone = 1 + 0.10 * weave + 0.10 * yarn + 0.05 * wear
    return to_image(np.asarray(rgb) * tone[..., None])


def rugs(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw woven rugs at 2 mm per texel, borders around a field of lozenges: (count, H, W, 3)."""
    height, width = shape
    v, u = np.mgrid[:height, :width]
    inset = np.minimum(np.minimum(u, width - 1 - u), np.minimum(v, height - 1 - v))
    dyes = np.array(((124, 52, 44), (52, 64, 92), (186, 160, 118), (74, 84, 62), (58, 44, 42)))
    made: list[Image] = []
    for _ in range(count):
        ground, field, figure, band = dyes[rng.permutation(len(dyes))[:4]]
        period = int(rng.integers(60, 110))
        steps = np.abs((u % period) - period / 2) // 5 + np.abs((v % period) - period / 2) // 5
        lozenge = steps * 10 < period * rng.uniform(0.5, 0.8)
        core = steps * 10 < period * 0.25
        colour = np.where(lozenge[..., None], figure, field).astype(np.float32)
        colour = np.where(core[..., None], band, colour)
        colour = np.where((inset < 70)[..., None], ground, colour)
        colour = np.where(((inset > 28) & (inset < 44))[..., None], band, colour)
        teeth = (inset >= 44) & (inset < 56) & ((u // 8 + v // 8) % 2 == 0)
        colour = np.where(teeth[..., None], figure, colour)
        fine, wear = fractal(rng, shape, (2, 6), 0.0), fractal(rng, shape, (20, 300), 1.0)
        yarn = 1 + 0.12 * fine + 0.05 * wear
        made.append(to_image(colour * yarn[..., None]))
    return np.stack(made)
