"""The sky with a far skyline, as the six faces of a cube."""

import numpy as np
from scipy.ndimage import map_coordinates

from scenes.surfaces import Shape
from scenes.surfaces.noise import blend, fractal, ramp, smoothstep, to_image
from vo.contract.arrays import Array, Image

HAZY = ((214, 219, 221), (196, 209, 220), (160, 186, 212), (118, 154, 196))
CLEAR = ((140, 149, 156), (112, 128, 146), (90, 112, 142), (70, 96, 136))
"""Colours of the sky from the horizon to 69 degrees."""


def town_sky(
    rng: np.random.Generator, side_px: int = 512, houses: float = 0.55, clear: bool = False
) -> Image:
    """Draw sky, clouds, tree line and roofs: (6 S, S, 3), +x -x +y -y +z -z in the world.

    `houses` is the share of the skyline that is built up; a clear sky is blue and has few clouds.
    """
    shaded = _shade(rng, face_rays(side_px), houses, clear)
    return np.concatenate([to_image(face) for face in shaded])


def window_view(rng: np.random.Generator, shape: Shape) -> Image:
    """Draw what a bright window shows, overexposed but for tree tops: (H, W, 3)."""
    up = np.linspace(1, 0, shape[0])[:, None]
    edge = 0.25 + 0.06 * fractal(rng, shape, (4, 200), 1.0)
    colour = ramp(((222, 226, 226), (206, 218, 230)), up * np.ones(shape))
    return to_image(blend(colour, (150, 160, 140), 0.8 * smoothstep(0.02, -0.02, up - edge)))


def face_rays(side_px: int) -> Array:
    """Unit ray of each texel: (6, S, S, 3), world axes."""
    t = (np.arange(side_px) + 0.5) / side_px * 2 - 1
    down, right = np.meshgrid(t, t, indexing="ij")
    one = np.ones_like(down)
    # OpenGL's cube faces, in a frame of y up and -z forward: right, left, up, down, front, back.
    faces = (
        (one, -down, -right), (-one, -down, right), (right, one, down),
        (right, -one, -down), (right, -down, one), (-right, -down, -one),
    )  # fmt: skip
    gl = np.stack([np.stack(face, axis=-1) for face in faces])
    world = np.stack([gl[..., 0], -gl[..., 2], gl[..., 1]], axis=-1)
    x, y, z = np.moveaxis(world, -1, 0)
    return world / np.sqrt(x * x + y * y + z * z)[..., None]


def _shade(rng: np.random.Generator, rays: Array, houses: float, clear: bool) -> Array:
    faces = np.full(rays.shape, (96.0, 100, 78))  # the ground, where nothing is drawn
    shown = ~(np.arcsin(rays[..., 2]) < -0.01)
    rays = rays[shown]
    azimuth, elevation = np.arctan2(rays[..., 1], rays[..., 0]), np.arcsin(rays[..., 2])
    colour = ramp(CLEAR if clear else HAZY, np.clip(elevation / 1.2, 0, 1))
    cloud = _panorama(fractal(rng, (512, 2048), (8, 500), 1.3, stretch=2.0), azimuth, elevation)
    cover = (0.12, 0.4, 2.6) if clear else (0.8, 0.1, 1.6)
    colour = blend(colour, (236, 236, 234), cover[0] * smoothstep(*cover[1:], cloud))
    x = (azimuth / (2 * np.pi) + 0.5) * 1024
    roofs = np.repeat(rng.uniform(0.02, 0.16, 64) * (rng.random(64) < houses), 16)
    crowns = 0.075 + 0.022 * _panorama(fractal(rng, (8, 2048), (6, 300), 0.9), azimuth, 0 * x)
    texture = _panorama(fractal(rng, (512, 2048), (3, 160), 0.9), azimuth, elevation)
    column = x.astype(int) % 1024
    house = ramp(((146, 136, 126), (176, 160, 142), (150, 112, 94)), (column // 16 % 7) / 6)
    windows = (np.sin(x * 1.6) > 0.35) & (np.sin(elevation * 190) > 0.2)
    house = blend(house, (92, 98, 106), 0.7 * windows)
    colour = np.where((elevation < roofs[column])[..., None], house, colour)
    trees = ramp(((40, 50, 34), (74, 88, 56), (116, 126, 88)), 0.28 + 4 * elevation + 0.2 * texture)
    colour = np.where((elevation < crowns)[..., None], trees, colour)
    near = smoothstep(0.22, 0.0, elevation) if clear else elevation < 0.2
    haze = 0.18 * near * (elevation > -0.02)
    faces[shown] = blend(colour, (206, 210, 210), haze)
    return faces


def _panorama(image: Array, azimuth: Array, elevation: Array) -> Array:
    """Sample an (H, W) image by direction; it wraps around and mirrors below the horizon."""
    height, width = image.shape
    column = (azimuth / (2 * np.pi) + 0.5) * width
    row = np.abs(elevation) / (np.pi / 2) * height
    return map_coordinates(image, [row, column], order=1, mode="grid-wrap")
