"""Tracks of the rover's wheels in sand, along a route: drawn in a texture of their own."""

from dataclasses import dataclass

import cv2
import numpy as np

from scenes.geometry.mesh import Mesh, merged
from scenes.geometry.routes import Ribbon
from scenes.lighting.baked_light import Light
from scenes.structures.ground import level, quads
from scenes.surfaces import sand
from scenes.surfaces.noise import fractal, to_image
from vo.contract.arrays import Array, Image

HALF_M = 0.30
"""Half the width of the strip that shows tracks."""
TEXEL_M = 0.002
PIECES = 8
"""Stretches of the route, one below the other in the texture."""
MARGIN_PX = 6
"""Rows of a piece beyond the strip, so that its rim shows nothing of the next piece."""
CELL_M = 0.08
WHEELS = ((0.19, 0.016, 0.0055), (-0.19, 0.016, 0.0055), (0.0, 0.011, 0.0035))
"""Offset to the left, half width and depth of the rut of each wheel, metres; the caster last."""
LUG_M = (0.014, 0.0012)
"""Distance and height of the bars that the lugs of the tyres press."""


@dataclass(frozen=True)
class Sand:
    """A square of sand that repeats: heights (S, S) in metres and colours (S, S, 3)."""

    heights: Array
    colours: Array

    def texture(self, light: Light) -> Image:
        """Draw it in a light: (S, S, 3); u is along x and v along y."""
        padded = np.pad(self.heights, 1, mode="wrap")
        dy, dx = (v[1:-1, 1:-1] / TEXEL_M for v in np.gradient(padded))
        return to_image(sand.shaded(self.colours, (dx, dy), light.key, _lamps(light)))


def _lamps(light: Light) -> tuple[Array, Array]:
    return light.key_rgb, light.fill_rgb + light.ambient_rgb


def track_texture(rng: np.random.Generator, ribbon: Ribbon, land: Sand, light: Light) -> Image:
    """Draw two drives along a route, the older one half blurred, into the relief of the sand.

    Returns:
        (PIECES R, C, 3); row r of a piece is `HALF_M` to the right of the route and more to the
        left with r, and its columns go along.
    """
    columns = round(ribbon.length_m / PIECES / TEXEL_M)
    s = np.linspace(0, ribbon.length_m, PIECES * columns, endpoint=False)
    reach = HALF_M + MARGIN_PX * TEXEL_M
    t = np.arange(-reach, reach, TEXEL_M, dtype=np.float32)[:, None]
    middle = ribbon.at(np.column_stack([s, np.zeros_like(s)]))
    left = ribbon.at(np.column_stack([s, np.ones_like(s)])) - middle
    side = len(land.heights)
    u, v = (
        np.ascontiguousarray((middle[:, k] + t * left[:, k]) / TEXEL_M % side, dtype=np.float32)
        for k in (0, 1)
    )
    heights, colours = (
        cv2.remap(image.astype(np.float32), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        for image in (land.heights, land.colours)
    )
    for strength, stray_m in ((0.5, 0.05), (1.0, 0.012)):
        stray = stray_m * fractal(rng, (1, len(s)), (400, 4000), 1.0)[0]
        heights = _pressed(heights, (s / LUG_M[0] % 1).astype(np.float32), t - stray, strength)
    along, across = (np.gradient(heights, TEXEL_M, axis=axis) for axis in (1, 0))
    left = left.astype(np.float32)
    rise = (along * left[:, 1] + across * left[:, 0], across * left[:, 1] - along * left[:, 0])
    image = to_image(sand.shaded(np.asarray(colours), rise, light.key, _lamps(light)))
    return np.concatenate(np.split(image, PIECES, axis=1))


def _pressed(heights: Array, turn: Array, t: Array, strength: float) -> Array:
    """Press ruts with berms and bars into heights (R, C) at offsets t (R, C) from the middle.

    The (C,) turns are the places between two bars, 0 to 1.
    """
    pressed = heights.copy()
    for offset, half, depth in WHEELS:
        rows = np.abs(t - offset).min(axis=1) < 3.5 * half
        away = np.abs(t[rows] - offset)
        inside = np.exp(-((away / half) ** 4))
        berm = np.exp(-(((away - 1.6 * half) / (0.5 * half)) ** 2))
        bars = LUG_M[1] * np.sin(2 * np.pi * (turn + 0.6 / LUG_M[0] * away)) if offset else 0.0
        change = inside * (bars - depth - 0.8 * pressed[rows]) + 0.45 * depth * berm
        pressed[rows] += strength * change
    return pressed


def track_mesh(ribbon: Ribbon) -> Mesh:
    """Lay the strip that shows the texture at z = 0 along the route."""
    length = ribbon.length_m / PIECES
    reach = HALF_M + MARGIN_PX * TEXEL_M
    meshes: list[Mesh] = []
    for k in range(PIECES):
        corners = quads((k * length, -HALF_M), ((k + 1) * length, HALF_M), CELL_M)
        u = corners[..., 0] / length - k
        v = (k + (corners[..., 1] + reach) / (2 * reach)) / PIECES
        meshes.append(ribbon.bent(level(corners, np.stack([u, v], axis=-1))))
    return merged(meshes)
