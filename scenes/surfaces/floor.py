"""Coverings of indoor and outdoor floors, at about 1 mm per texel."""

import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, ramp, rim, smoothstep, to_image
from vo.contract.arrays import Image


def linoleum(rng: np.random.Generator, side_px: int, rgb: Rgb) -> Image:
    """Draw plain sheet flooring, faintly mottled, with a few heel marks: (S, S, 3), tiling."""
    size = (side_px, side_px)
    mottle = fractal(rng, size, (4, 60), 0.8)
    chips = fractal(rng, size, (2.5, 9), 0.0)
    colour = np.asarray(rgb) * (1 + 0.013 * mottle)[..., None]
    colour = blend(colour, np.asarray(rgb) * 0.80, 0.7 * smoothstep(1.7, 2.6, chips))
    colour = blend(colour, np.asarray(rgb) * 1.14, 0.7 * smoothstep(1.7, 2.6, -chips))
    heels = fractal(rng, size, (5, 40), 0.4, stretch=5.0)
    return to_image(blend(colour, (54, 52, 50), 0.5 * smoothstep(3.7, 4.4, heels)))


def asphalt(rng: np.random.Generator, side_px: int) -> Image:
    """Draw worn asphalt, chips of stone up to 8 mm in dark binder: (S, S, 3), tiling.

    It has no features larger than a few stones, so any two pieces of it look alike.
    """
    size = (side_px, side_px)
    chips = fractal(rng, size, (3.2, 9), 0.0)
    fine = fractal(rng, size, (1.8, 5), 0.0)
    tone = fractal(rng, size, (5, 12), 0.0)
    binder = 80 * (1 + 0.10 * fine + 0.05 * fractal(rng, size, (10, 120), 0.8))
    tones = ((104, 102, 100), (138, 134, 128), (168, 161, 152), (196, 190, 180))
    stone = ramp(tones, 0.42 + 0.2 * tone)
    colour = binder[..., None] * np.array([1.0, 0.99, 0.99], dtype=np.float32)
    colour = blend(colour, stone, 0.85 * smoothstep(0.15, 0.8, chips))
    colour = blend(colour, (54, 53, 53), 0.6 * smoothstep(1.0, 2.0, -chips))  # pits
    return to_image(colour * (1 + 0.05 * fine)[..., None])


def roadway(rng: np.random.Generator, side_px: int) -> Image:
    """Draw asphalt that has carried traffic: as `asphalt`, blotched up to a tenth of a metre."""
    size = (side_px, side_px)
    blotches = fractal(rng, size, (8, 110), 0.5)
    dark = smoothstep(1.3, 2.2, fractal(rng, size, (12, 60), 0.3))
    colour = asphalt(rng, side_px) * (1 + 0.16 * blotches)[..., None]
    return to_image(blend(colour, (46, 45, 45), 0.55 * dark))


def road_paint(rng: np.random.Generator, shape: Shape, wear: float, ground: Image) -> Image:
    """Draw a stripe of road paint along u, rubbed through to the `ground` below: (H, W, 3).

    The stripe leaves a tenth of the height free on either side for its ragged edges.
    """
    height, width = shape
    base = ground[np.arange(height)[:, None] % len(ground), np.arange(width) % len(ground)]
    grain = fractal(rng, shape, (2, 12), 0.2)
    rubbed = 0.6 * grain + fractal(rng, shape, (20, 600), 1.2)
    v = np.abs(np.arange(height) / (height - 1) - 0.5)[:, None]
    edge = smoothstep(0.41, 0.39, v + 0.006 * grain)
    cover = edge * smoothstep(2.6 - 3.4 * wear + 0.7, 2.6 - 3.4 * wear, rubbed)
    paint = np.array((206, 204, 196)) * (1 + 0.04 * grain)[..., None]
    return to_image(blend(base.astype(np.float32), paint, 0.92 * cover))


def iron_cover(rng: np.random.Generator, side_px: int) -> Image:
    """Draw a square cast-iron cover of a shaft in its frame: (S, S, 3)."""
    v, u = np.mgrid[:side_px, :side_px] / (side_px - 1) - 0.5
    rust = fractal(rng, (side_px, side_px), (2, side_px), 1.0)
    colour = np.array((104, 92, 82)) * (1 + 0.10 * rust)[..., None]
    ribs = (np.sin(44 * (u + v)) > 0.1) & (np.sin(44 * (u - v)) > 0.1)
    inside = np.maximum(np.abs(u), np.abs(v))
    colour = blend(colour, (62, 56, 52), 0.7 * (ribs & (inside < 0.41)))
    return to_image(blend(colour, (34, 32, 32), 0.9 * (np.abs(inside - 0.43) < 0.012)))


def paving_slabs(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw cast paving slabs with a washed face, joints included: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    cloud = fractal(rng, size, (20, 2 * side_px), 1.3)
    grit = fractal(rng, size, (2.4, 8), 0.1)
    grain = fractal(rng, size, (1.6, 4), 0.0)
    batch = rng.normal(0, 0.05, (count, 1, 1))
    tint = np.array([156, 150, 140]) * (1 + 0.008 * rng.standard_normal((count, 1, 1, 3)))
    colour = tint * (1 + batch + 0.06 * cloud + 0.08 * grain)[..., None]
    colour = blend(colour, (92, 86, 80), 0.8 * smoothstep(0.5, 1.4, grit))
    colour = blend(colour, (206, 198, 184), 0.75 * smoothstep(0.8, 1.6, -grit))
    stain = fractal(rng, size, (8, side_px), 1.4) + 0.4 * rng.standard_normal((count, 1, 1))
    colour = blend(colour, (88, 84, 70), 0.5 * smoothstep(1.1, 2.6, stain))
    ragged = rim((side_px, side_px)) + 0.7 * grit + 0.8 * cloud
    colour = blend(colour, (190, 184, 172), 0.25 * smoothstep(9, 4, ragged))
    return to_image(blend(colour, (58, 54, 46), 0.9 * smoothstep(4.2, 1.6, ragged)))


def granite_setts(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw the worn tops of small granite blocks in their sand joints: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    tone = rng.beta(2, 2, (count, 1, 1))
    cloud = fractal(rng, size, (14, 2 * side_px), 1.2)
    tones = ((122, 120, 120), (150, 146, 142), (170, 162, 154), (190, 186, 180))
    face = ramp(tones, tone + 0.08 * cloud)
    face *= 1 + 0.012 * rng.standard_normal((count, 1, 1, 3))
    grain = fractal(rng, size, (1.8, 6), 0.0)
    face = blend(face, (196, 190, 182), 0.6 * smoothstep(0.9, 1.8, grain))
    face = blend(face, (62, 60, 62), 0.7 * smoothstep(1.0, 1.9, -grain))
    dirt = fractal(rng, size, (4, side_px), 1.1) + 0.4 * rng.standard_normal((count, 1, 1))
    face = blend(face, (92, 86, 76), 0.5 * smoothstep(0.9, 2.4, dirt))
    v, u = np.abs(np.mgrid[:side_px, :side_px] / (side_px - 1) * 2 - 1)
    round_ = (u**5 + v**5) ** 0.2 + 0.018 * cloud + 0.01 * grain
    face *= (1 - 0.35 * smoothstep(0.72, 0.98, round_))[..., None]
    sand = np.array((100, 92, 78)) * (1 + 0.12 * grain)[..., None]
    return to_image(blend(face, sand, smoothstep(0.90, 0.97, round_)))


def water(rng: np.random.Generator, side_px: int) -> Image:
    """Draw still, slightly rippled water under a bright sky: (S, S, 3), tiling."""
    ripple = fractal(rng, (side_px, side_px), (20, 160), 0.8)
    return to_image(ramp(((66, 88, 92), (104, 128, 132), (168, 186, 190)), 0.42 + 0.16 * ripple))


def parquet(rng: np.random.Generator, count: int, shape: Shape, rgb: Rgb) -> Image:
    """Draw oiled planks with the grain along u, each of its own tone: (count, H, W, 3)."""
    size = (count, *shape)
    drift = fractal(rng, size, (40, 900), 1.5, stretch=7.0)
    rings = np.sin(7 * drift + 1.6 * fractal(rng, size, (6, 300), 1.1, stretch=12.0))
    pores = fractal(rng, size, (2, 10), 0.2, stretch=8.0)
    tone = 1 + rng.normal(0, 0.09, (count, 1, 1)) + 0.07 * rings + 0.04 * drift + 0.02 * pores
    colour = np.asarray(rgb) * tone[..., None]
    colour = blend(colour, np.asarray(rgb) * 0.5, 0.55 * smoothstep(1.2, 2.3, pores))
    scuffs = fractal(rng, size, (3, 60), 0.6, stretch=3.0)
    colour = blend(colour, np.asarray(rgb) * 0.8 + 40, 0.4 * smoothstep(2.2, 3.2, scuffs))
    inset = rim(shape)
    return to_image(blend(colour, np.asarray(rgb) * 0.3, 0.8 * smoothstep(1.8, 0.2, inset)))


def terrazzo(rng: np.random.Generator, side_px: int) -> Image:
    """Draw ground stone chips of 5 to 20 mm in pale cement: (S, S, 3), tiling."""
    size = (side_px, side_px)
    body = fractal(rng, size, (2, 60), 0.6)
    colour = np.array((176, 172, 162)) * (1 + 0.025 * body)[..., None]
    for chip in ((112, 104, 96), (206, 200, 190), (148, 112, 92), (92, 98, 100)):
        grain = fractal(rng, size, (8, 28), 0.0) + 0.2 * fractal(rng, size, (3, 8), 0.0)
        colour = blend(colour, chip, 0.8 * smoothstep(1.35, 1.6, grain))
    return to_image(colour)
