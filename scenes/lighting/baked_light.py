"""Light baked into the shading normals: soft shadows at no cost to the renderer.

The renderer lights each vertex by max(n . l, 0) for every lamp l and blends along the triangle.
There are two lamps, a `key` (the sun, a ceiling panel) and a `fill` straight above (the sky).
The two shares that a vertex should receive, shadows and occlusion included, are two numbers;
a unit normal has two degrees of freedom; so the normal that yields exactly these shares is solved
for and stored in the mesh instead of the geometric one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from vo.contract.arrays import Array

Rgb = tuple[float, float, float]
FILL_SHARE = 0.5
"""Share of a full sky that an unoccluded upward vertex takes; keeps the normals solvable."""


@dataclass(frozen=True)
class Light:
    """The lamps of a scene.

    Attributes:
        key: (3,) unit vector towards the key lamp, world.
        key_rgb: (3,) colour of the key lamp at full incidence.
        fill_rgb: (3,) colour that an unoccluded upward surface receives from the fill.
        ambient_rgb: (3,) colour that every surface receives.
        softness_rad: Angular radius of the key lamp; widens penumbrae.
    """

    key: Array
    key_rgb: Array
    fill_rgb: Array
    ambient_rgb: Array
    softness_rad: float = 0.02

    def install(self, spec: mujoco.MjSpec) -> None:
        """Add the lamps, none of which casts a rendered shadow, to the world."""
        world = spec.worldbody
        up = np.array([0, 0, 1.0])
        lamps = (("key", self.key, self.key_rgb), ("fill", up, self.fill_rgb / FILL_SHARE))
        for name, towards, rgb in lamps:
            added = world.add_light(name=name, dir=-towards, pos=20 * towards, diffuse=rgb)
            added.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
            added.ambient = added.specular = (0, 0, 0)
            added.castshadow = False
        headlight = spec.visual.headlight
        headlight.ambient = self.ambient_rgb
        headlight.diffuse = headlight.specular = (0, 0, 0)


def shaded_normals(normals: Array, key_share: Array, fill_share: Array, light: Light) -> Array:
    """Solve for the normals under which the renderer gives each vertex its baked light.

    Args:
        normals: (V, 3) geometric unit normals.
        key_share: (V,) visibility of the key lamp, in [0, 1].
        fill_share: (V,) openness to the fill, in [0, 1].
        light: The lamps.

    Returns:
        (V, 3) unit normals n with n . key = key_share max(normal . key, 0) and n . z = FILL_SHARE
        times fill_share times the hemisphere seen; where no unit vector has both, the key's share
        is kept and the fill's is the nearest possible.
    """
    key = key_share * np.maximum(normals @ light.key, 0)
    return solved_normals(key, fill_share * (0.55 + 0.45 * normals[:, 2]), light)


def solved_normals(key: Array, sky: Array, light: Light) -> Array:
    """Solve for unit normals (V, 3) that receive given shares of both lamps, each (V,) in [0, 1].

    The key's is n . key, the sky's that of the fill of an unoccluded upward surface; see
    `shaded_normals` for what is kept where not both are possible.
    """
    k, fill = float(light.key[2]), FILL_SHARE * sky
    # |n| = 1 needs key² + fill² - 2 k key fill <= 1 - k²: an interval of fill around k key.
    slack = np.sqrt((1 - k * k) * np.maximum(1 - key * key, 0)) * 0.999
    fill = np.clip(fill, k * key - slack, k * key + slack)
    along_key = (key - k * fill) / (1 - k * k)
    along_z = (fill - k * key) / (1 - k * k)
    z = np.array([0, 0, 1.0])
    across = np.cross(light.key, z) / np.sqrt(1 - k * k)
    planar = along_key[:, None] * light.key + along_z[:, None] * z
    rest = np.sqrt(np.maximum(1 - (planar**2).sum(axis=1), 0))
    return planar + rest[:, None] * across


def sun(rng: np.random.Generator, elevation_deg: tuple[float, float] = (36, 56)) -> Light:
    """Shine from a random side of a clear sky; all lamps together light level ground by about 1."""
    return lamp(
        (rng.uniform(0, 2 * np.pi), rng.uniform(*elevation_deg)),
        on_ground=(0.45, 0.43, 0.39),
        fill=(0.34, 0.355, 0.38),
        ambient=(0.21, 0.21, 0.22),
    )


def hall_light(rng: np.random.Generator, elevation_deg: tuple[float, float] = (55, 68)) -> Light:
    """Light a room from wide ceiling panels; all together light the floor by about 1."""
    return lamp(
        (rng.uniform(0, 2 * np.pi), rng.uniform(*elevation_deg)),
        on_ground=(0.30, 0.298, 0.285),
        fill=(0.38, 0.376, 0.362),
        ambient=(0.32, 0.318, 0.31),
        softness_rad=0.5,
    )


def lamp(
    angles: Sequence[float], on_ground: Rgb, fill: Rgb, ambient: Rgb, softness_rad: float = 0.02
) -> Light:
    """Build a light from the azimuth in radians and elevation in degrees of its key lamp.

    `on_ground` is the colour that level ground receives from the key; the others as in `Light`.
    """
    azimuth, elevation = angles[0], np.radians(angles[1])
    flat = np.cos(elevation)
    return Light(
        key=np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]),
        key_rgb=np.array(on_ground) / np.sin(elevation),
        fill_rgb=np.array(fill),
        ambient_rgb=np.array(ambient),
        softness_rad=softness_rad,
    )
