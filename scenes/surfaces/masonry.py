"""Baked clay, sand, concrete, plaster and gravel."""

import cv2
import numpy as np

from scenes.surfaces import Rgb, Shape
from scenes.surfaces.noise import blend, fractal, ramp, rim, smoothstep, to_image
from vo.contract.arrays import Array, Image

CLAY = ((200, 162, 136), (184, 136, 114), (168, 122, 106), (150, 114, 104), (132, 110, 106))
"""Colours of bricks, from underfired to overfired."""


def paving_bricks(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw worn clay pavers at 1 mm per texel: (count, H, W, 3), each different."""
    height, width = shape
    size = (count, height, width)
    tone = rng.beta(2.2, 2.2, count)[:, None, None]
    cloud = fractal(rng, size, (14, 180), 1.4)
    grain = fractal(rng, size, (1.6, 6), 0.2)
    speck = fractal(rng, size, (3.0, 9), 0.0)
    scuff = fractal(rng, size, (2.5, 60), 0.9, stretch=4.0)
    lump = fractal(rng, size, (5, 26), 0.4)
    face = ramp(CLAY, tone + 0.12 * cloud + 0.05 * lump)
    face *= (1 + 0.055 * grain + 0.04 * lump + 0.03 * scuff)[..., None]
    face *= 1 + 0.018 * rng.standard_normal((count, 1, 1, 3)).astype(np.float32)
    face = blend(face, (208, 176, 150), 0.60 * smoothstep(1.5, 2.4, speck))  # grog
    face = blend(face, (56, 44, 42), 0.80 * smoothstep(1.5, 2.2, -speck))  # pits
    stain = fractal(rng, size, (30, 260), 1.6) + 0.5 * rng.standard_normal((count, 1, 1))
    face = blend(face, (84, 74, 66), 0.45 * smoothstep(0.7, 2.2, stain))
    bloom = fractal(rng, size, (4, 120), 1.2) + 0.5 * rng.standard_normal((count, 1, 1))
    face = blend(face, (206, 192, 178), 0.42 * smoothstep(1.2, 2.8, bloom))  # efflorescence
    return to_image(_worn_edges(face, scuff, grain))


def _worn_edges(face: Array, coarse: Array, fine: Array) -> Array:
    """Chip and dirty the rim of (N, H, W, 3) pavers, by (N, H, W) noises."""
    ragged = rim(face.shape[1:3]) + 1.6 * coarse + 0.8 * fine
    face = blend(face, (190, 156, 132), 0.30 * smoothstep(9, 4, ragged))
    return blend(face, (62, 50, 44), 0.85 * smoothstep(3.5, 0.5, ragged))


def wall_bricks(rng: np.random.Generator, count: int, shape: Shape) -> Image:
    """Draw smoother facing bricks, at 1.5 mm per texel: (count, H, W, 3)."""
    size = (count, *shape)
    tone = rng.beta(2, 2, count)[:, None, None]
    cloud = fractal(rng, size, (8, 140), 1.3, stretch=2.0)
    grain = fractal(rng, size, (1.6, 7), 0.3)
    face = ramp(((186, 142, 114), (166, 114, 92), (138, 98, 84)), tone + 0.12 * cloud)
    face *= (1 + 0.05 * grain)[..., None]
    soot = fractal(rng, size, (6, 140), 1.2)
    face = blend(face, (78, 66, 60), 0.5 * smoothstep(0.9, 2.4, soot))
    return to_image(_worn_edges(face, cloud, grain))


def sand(rng: np.random.Generator, side_px: int) -> Image:
    """Draw damp jointing sand with moss and grit: (S, S, 3), tiling."""
    size = (side_px, side_px)
    body = fractal(rng, size, (2, 200), 0.9)
    grain = fractal(rng, size, (1.5, 4), 0.0)
    colour = ramp(((78, 66, 54), (112, 98, 80), (142, 126, 104)), 0.5 + 0.14 * body)
    colour *= (1 + 0.12 * grain)[..., None]
    moss = fractal(rng, size, (3, 400), 1.3)
    return to_image(blend(colour, (66, 74, 40), 0.8 * smoothstep(0.5, 1.5, moss)))


def concrete(rng: np.random.Generator, shape: Shape, tone: float = 150.0) -> Image:
    """Draw weathered concrete of a mean grey `tone`: (H, W, 3), tiling."""
    cloud = fractal(rng, shape, (20, max(shape)), 1.5)
    grain = fractal(rng, shape, (1.5, 8), 0.2)
    holes = fractal(rng, shape, (4, 14), 0.0)
    grey = tone * (1 + 0.07 * cloud + 0.045 * grain)
    colour = grey[..., None] * np.array([1.0, 0.98, 0.94], dtype=np.float32)
    colour = blend(colour, (70, 68, 62), 0.7 * smoothstep(2.1, 2.8, holes))
    stain = fractal(rng, shape, (12, max(shape)), 1.4)
    return to_image(blend(colour, (96, 92, 78), 0.5 * smoothstep(0.8, 2.2, stain)))


def slab(rng: np.random.Generator, side_px: int, joint_px: int = 8) -> Image:
    """Draw a floated concrete slab, sawn around its edge: (S, S, 3); S is a multiple of 4.

    Stains and scuffs are drawn at half that size, only the grain is as fine as the texels.
    """
    half = (side_px // 2, side_px // 2)
    cloud = fractal(rng, half, (20, side_px), 1.3)
    tone = 150 * (1 + 0.06 * cloud + 0.05 * fractal(rng, half, (3, 14), 0.3))
    coarse = tone[..., None] * np.array([1.0, 0.985, 0.95], dtype=np.float32)
    oil = smoothstep(1.3, 2.6, fractal(rng, half, (8, 400), 1.3))
    coarse = blend(coarse, (84, 80, 74), 0.55 * oil)
    scuff = fractal(rng, half, (2, 60), 0.5, stretch=12.0) + 0.8 * cloud
    coarse = blend(coarse, (74, 72, 70), 0.5 * smoothstep(1.6, 2.8, scuff))
    crack = np.abs(fractal(rng, half, (12, 700), 1.5))
    here = smoothstep(0.9, 1.5, fractal(rng, half, (100, 900), 1.5))
    coarse = blend(coarse, (70, 68, 64), 0.8 * here * smoothstep(0.025, 0.0, crack))
    full = np.asarray(cv2.resize(coarse, (side_px, side_px), interpolation=cv2.INTER_LINEAR))
    speck = fractal(rng, (side_px, side_px), (1.6, 7), 0.2)
    full *= (1 + 0.065 * speck)[..., None]
    full = blend(full, (66, 64, 60), 0.7 * smoothstep(2.2, 3.0, speck))
    inset = rim((side_px, side_px))
    sawn = smoothstep(0.5 * joint_px + 1.5, 0.5 * joint_px - 1.5, inset + 0.5 * speck)
    return to_image(blend(full, (58, 55, 50), 0.85 * sawn))


def terrazzo_tiles(rng: np.random.Generator, count: int, side_px: int) -> Image:
    """Draw polished marble chips at 1 mm per texel, joints around: (count, S, S, 3)."""
    size = (count, side_px, side_px)
    colour = np.array([176, 170, 158]) * (1 + 0.03 * fractal(rng, size, (2, 8), 0.0))[..., None]
    chips = (
        (7, 16, (214, 208, 196)), (6, 14, (128, 112, 98)), (5, 12, (92, 90, 88)),
        (9, 24, (196, 172, 146)), (4, 9, (70, 68, 66)),
    )  # fmt: skip
    for shortest, longest, rgb in chips:
        here = smoothstep(1.05, 1.25, fractal(rng, size, (shortest, longest), 0.0))
        colour = blend(colour, rgb, 0.9 * here)
    wear = fractal(rng, size, (40, 900), 1.3) + 0.4 * rng.standard_normal((count, 1, 1))
    colour *= (1 + 0.05 * wear)[..., None]
    inset = rim((side_px, side_px))
    return to_image(blend(colour, (84, 80, 74), 0.8 * np.broadcast_to(inset < 2, size)))


def plaster(rng: np.random.Generator, shape: Shape, rgb: Rgb, dirt: float = 1.0) -> Image:
    """Draw painted rough plaster, dirtier towards the bottom row: (H, W, 3), tiling along u.

    `dirt` is the strength of grime and cracks: 1 outdoors, less indoors.
    """
    height, _ = shape
    cloud = fractal(rng, shape, (30, 900), 1.5)
    trowel = fractal(rng, shape, (4, 40), 0.7, stretch=2.5)
    grain = fractal(rng, shape, (1.5, 4), 0.0)
    colour = np.asarray(rgb) * (1 + 0.03 * cloud + 0.03 * trowel + 0.03 * grain)[..., None]
    down = np.linspace(-1, 1, height)[:, None]
    grime = fractal(rng, shape, (4, 700), 1.2) + 2.4 * down
    colour = blend(colour, (104, 94, 80), 0.5 * dirt * smoothstep(1.6, 4.2, grime))
    crack = np.abs(fractal(rng, shape, (10, 500), 1.5))
    here = smoothstep(0.8, 1.6, fractal(rng, shape, (80, 900), 1.5))
    return to_image(blend(colour, (88, 80, 70), 0.7 * dirt * here * smoothstep(0.05, 0.0, crack)))


def painted_wall(rng: np.random.Generator, shape: Shape, rgb: Rgb) -> Image:
    """Draw a smooth wall under paint from a roller, nearly blank: (H, W, 3), tiling."""
    cloud = fractal(rng, shape, (40, max(shape)), 1.4)
    roller = fractal(rng, shape, (1.5, 8), 0.2)
    marks = fractal(rng, shape, (3, 30), 0.5, stretch=3.0)
    colour = np.asarray(rgb) * (1 + 0.010 * cloud + 0.005 * roller)[..., None]
    return to_image(blend(colour, np.asarray(rgb) * 0.72, 0.6 * smoothstep(3.9, 4.8, marks)))


def gravel(rng: np.random.Generator, side_px: int, stone_px: float = 14.0) -> Image:
    """Draw rounded pebbles as the nearest of jittered centres: (S, S, 3), tiling."""
    cells = max(2, int(side_px / stone_px))
    pitch = side_px / cells
    centre = (
        rng.uniform(0.1, 0.9, (cells, cells, 2))
        + np.stack(np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"), axis=-1)
    ) * pitch
    v, u = np.mgrid[:side_px, :side_px]
    warp = fractal(rng, (2, side_px, side_px), (6, 60), 1.0) * 1.3
    rv, ru = v + warp[0], u + warp[1]
    iv, iu = (rv // pitch).astype(int), (ru // pitch).astype(int)
    nearest = np.full((side_px, side_px), np.inf)
    second = nearest.copy()
    owner = np.zeros((side_px, side_px), dtype=int)
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            cv, cu = (iv + dv) % cells, (iu + du) % cells
            gap_v = (rv - centre[cv, cu, 0] + side_px / 2) % side_px - side_px / 2
            gap_u = (ru - centre[cv, cu, 1] + side_px / 2) % side_px - side_px / 2
            distance = np.hypot(gap_v, gap_u)
            closer = distance < nearest
            second = np.where(closer, nearest, np.minimum(second, distance))
            owner = np.where(closer, cv * cells + cu, owner)
            nearest = np.where(closer, distance, nearest)
    tone = rng.beta(2, 2, cells * cells)[owner]
    colour = ramp(((86, 82, 78), (134, 126, 114), (172, 160, 142), (196, 190, 180)), tone)
    dome = smoothstep(0, 0.55, (second - nearest) / pitch)
    grain = fractal(rng, (side_px, side_px), (1.5, 6), 0.3)
    return to_image(colour * (0.30 + 0.72 * dome * (1 + 0.08 * grain))[..., None])
