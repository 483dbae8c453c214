"""What house fronts are made of: window panes, roller shutters, blocks and roof tiles."""

import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, ramp, smoothstep, to_image
from vo.contract.arrays import Image


def panes(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw windows by day: dark glass, curtains and what it mirrors: (count, H, W, 3)."""
    v, u = np.mgrid[: shape[0], : shape[1]] / np.array(shape).reshape(2, 1, 1)
    size = (count, *shape)
    mirrored = fractal(rng, size, (4, 60), 1.0)
    colour = ramp(((14, 17, 20), (38, 44, 50), (84, 94, 102)), 0.32 + 0.2 * mirrored)
    reach, curtained = rng.uniform(0.12, 0.34, (count, 1, 1)), rng.random((count, 1, 1)) < 0.6
    folds = 0.75 + 0.25 * np.sin(u * rng.uniform(60, 110, (count, 1, 1)) + mirrored)
    curtain = np.minimum(u, 1 - u) < reach + 0.06 * v
    colour = blend(colour, np.array((196, 192, 182)) * folds[..., None], 0.7 * curtain * curtained)
    blind = (v < rng.uniform(0.1, 0.5, (count, 1, 1))) & (rng.random((count, 1, 1)) < 0.25)
    return to_image(blend(colour, (206, 202, 190), 0.8 * blind))


def slats(rng: np.random.Generator, side_px: int, rgb: Rgb, rows: int = 16) -> Image:
    """Draw a roller shutter, its slats along u: (S, S, 3), tiling."""
    v = np.arange(side_px)[:, None] / side_px * rows % 1
    dust = fractal(rng, (side_px, side_px), (2, side_px), 1.0)
    colour = np.asarray(rgb) * ((0.8 + 0.2 * np.sin(np.pi * v)) * (1 + 0.04 * dust))[..., None]
    return to_image(blend(colour, np.asarray(rgb) * 0.3, 0.9 * (v > 0.84) + 0 * dust))


def roughcast(rng: np.random.Generator, side_px: int, rgb: Rgb) -> Image:
    """Draw rough plaster outdoors, with streaks where rain ran down: (S, S, 3), tiling."""
    size = (side_px, side_px)
    grain = fractal(rng, size, (1.6, 5), 0.0)
    lumps = fractal(rng, size, (4, 40), 0.4)
    streaks = fractal(rng, size, (3, side_px), 1.0, stretch=0.12)
    colour = np.asarray(rgb) * (1 + 0.05 * grain + 0.04 * lumps + 0.02 * streaks)[..., None]
    colour = blend(colour, np.asarray(rgb) * 0.45, 0.6 * smoothstep(1.2, 2.2, -grain - 0.5 * lumps))
    return to_image(blend(colour, (112, 104, 92), 0.45 * smoothstep(0.9, 2.6, streaks)))


def blockwork(
    rng: np.random.Generator, shape: Shape, courses: int, columns: int, colours: tuple[Rgb, Rgb]
) -> Image:
    """Draw a wall of blocks between two colours, in mortar: (H, W, 3), tiling if courses are even.

    Every other course is shifted by half a block.
    """
    v, u = np.mgrid[: shape[0], : shape[1]] / np.array(shape).reshape(2, 1, 1)
    row = (v * courses).astype(int)
    along = u * columns + 0.5 * (row % 2)
    tone = rng.beta(1.6, 1.6, (courses, columns))[row, along.astype(int) % columns]
    grain = fractal(rng, shape, (2, 40), 0.5)
    colour = ramp(colours, tone + 0.08 * grain) * (1 + 0.05 * grain)[..., None]
    pitch = np.array(shape) / (courses, columns)
    rim = np.minimum(
        *(
            np.minimum(x % 1, 1 - x % 1) * p
            for x, p in zip((v * courses, along), pitch, strict=True)
        )
    )
    return to_image(blend(colour, (176, 170, 160), 0.85 * smoothstep(2.0, 0.8, rim + 0.3 * grain)))


def roof_tiles(rng: np.random.Generator, side_px: int, rgb: Rgb, rows: int = 12) -> Image:
    """Draw courses of pantiles: (S, S, 3), tiling."""
    v, u = (x / side_px * rows for x in np.mgrid[:side_px, :side_px])
    tone = 1 + 0.14 * rng.standard_normal((rows, rows))[v.astype(int), u.astype(int)]
    moss = fractal(rng, (side_px, side_px), (3, side_px), 1.0)
    wave = 0.78 + 0.22 * np.sin(np.pi * (u % 1))
    colour = np.asarray(rgb) * (tone * wave * (1 + 0.06 * moss))[..., None]
    return to_image(blend(colour, np.asarray(rgb) * 0.3, 0.8 * (v % 1 > 0.86) + 0 * moss))
