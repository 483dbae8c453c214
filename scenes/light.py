"""Light baked into the shading normals: soft shadows that cost the renderer nothing.

The renderer lights each vertex by max(n . l, 0) for every lamp l and blends along the triangle.
There are two lamps, a `key` (the sun, a ceiling panel) and a `fill` straight above (the sky).
The two shares that a vertex should receive, shadows and occlusion included, are two numbers;
a unit normal has two degrees of freedom; so the normal that yields exactly these shares is solved
for and stored in the mesh instead of the geometric one.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from vo.contract.arrays import Array

FILL_SHARE = 0.5  # of a full sky that an unoccluded upward vertex takes: keeps normals solvable


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
        fill = self.fill_rgb / FILL_SHARE
        for name, towards, rgb in (
            ("key", self.key, self.key_rgb),
            ("fill", np.array([0, 0, 1.0]), fill),
        ):
            world.add_light(
                name=name,
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                dir=-np.asarray(towards),
                pos=20 * np.asarray(towards),
                diffuse=rgb,
                ambient=(0, 0, 0),
                specular=(0, 0, 0),
                castshadow=False,
            )
        headlight = spec.visual.headlight
        headlight.ambient = self.ambient_rgb
        headlight.diffuse = (0, 0, 0)
        headlight.specular = (0, 0, 0)


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
    k = float(light.key[2])
    key = key_share * np.maximum(normals @ light.key, 0)
    fill = FILL_SHARE * fill_share * (0.55 + 0.45 * normals[:, 2])
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
