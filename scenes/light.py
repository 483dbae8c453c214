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
from numba import njit
from scipy.ndimage import map_coordinates

from vo.contract.arrays import Array

FILL_SHARE = 0.5  # of a full sky that an unoccluded upward vertex takes: keeps normals solvable


@dataclass(frozen=True)
class Blocker:
    """A box that casts shadows.

    Attributes:
        centre: (3,) metres, world.
        half: (3,) half sizes, metres.
        yaw_rad: Turn about z.
        opacity: Share of light that it stops; foliage less than 1.
    """

    centre: Array
    half: Array
    yaw_rad: float = 0.0
    opacity: float = 1.0


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


def visibility(points: Array, blockers: list[Blocker], light: Light, samples: int = 6) -> Array:
    """Share of the key lamp seen from each point.

    Args:
        points: (N, 3) metres, world.
        blockers: What casts shadows.
        light: Gives the lamp's direction and its angular radius.
        samples: Rays over the lamp's disc.

    Returns:
        (N,) in [0, 1].
    """
    if not blockers:
        return np.ones(len(points))
    side = np.cross(light.key, [0, 0, 1.0] if abs(light.key[2]) < 0.99 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    up = np.cross(side, light.key)
    k = np.arange(samples)[:, None]
    radius = light.softness_rad * np.sqrt((k + 0.5) / samples)
    turn = k * np.pi * (3 - np.sqrt(5))  # sunflower: even cover of the disc
    rays = light.key + radius * (np.cos(turn) * side + np.sin(turn) * up)
    return _seen(np.ascontiguousarray(points, dtype=np.float64), rays, *_table(blockers))


def _table(blockers: list[Blocker]) -> tuple[Array, Array, Array, Array]:
    """Centres (B, 3), half sizes (B, 3), cosine and sine of the turns (B, 2), opacities (B,)."""
    yaw = np.array([b.yaw_rad for b in blockers])
    return (
        np.array([b.centre for b in blockers]),
        np.array([b.half for b in blockers]),
        np.column_stack([np.cos(yaw), np.sin(yaw)]),
        np.array([b.opacity for b in blockers]),
    )


@njit(cache=True)
def _seen(
    points: Array, rays: Array, centres: Array, halves: Array, turns: Array, opacities: Array
) -> Array:
    """Mean over (S, 3) rays of the light left behind all boxes: (N,), slab test in each frame."""
    seen = np.zeros(len(points))
    for n in range(len(points)):
        for s in range(len(rays)):
            left = 1.0
            for b in range(len(centres)):
                dx, dy = points[n, 0] - centres[b, 0], points[n, 1] - centres[b, 1]
                rx, ry = rays[s, 0], rays[s, 1]
                c, t = turns[b, 0], turns[b, 1]
                start = (c * dx + t * dy, c * dy - t * dx, points[n, 2] - centres[b, 2])
                along = (c * rx + t * ry, c * ry - t * rx, rays[s, 2])
                enter, leave = -1e9, 1e9
                for axis in range(3):
                    inverse = 1 / along[axis] if abs(along[axis]) > 1e-9 else 1e9
                    near = (-halves[b, axis] - start[axis]) * inverse
                    far = (halves[b, axis] - start[axis]) * inverse
                    enter, leave = max(enter, min(near, far)), min(leave, max(near, far))
                if leave > enter and enter > -1e-3:  # a box does not shade its own surface
                    left *= 1 - opacities[b]
            seen[n] += left / len(rays)
    return seen


def occlusion(points: Array, blockers: list[Blocker], reach_m: float = 0.5) -> Array:
    """Dim the fill close to the blockers: (N,) in [0, 1] for (N, 3) points, 1 in the open."""
    open_share = np.ones(len(points))
    for blocker in blockers:
        c, s = np.cos(blocker.yaw_rad), np.sin(blocker.yaw_rad)
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
        outside = np.abs((points - blocker.centre) @ R.T) - blocker.half
        distance = np.linalg.norm(np.maximum(outside, 0), axis=1)
        dim = 0.55 * blocker.opacity * np.exp(-3 * distance / reach_m)
        open_share *= np.where(distance > 1e-3, 1 - dim, 1.0)
    return open_share


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


@dataclass(frozen=True)
class LightMap:
    """Key and fill shares on the ground, sampled once on a grid and looked up between.

    Attributes:
        origin: (2,) x, y of the first sample, metres.
        step_m: Spacing of the samples.
        shares: (2, nx, ny) key and fill shares.
    """

    origin: Array
    step_m: float
    shares: Array

    def at(self, points: Array) -> tuple[Array, Array]:
        """Interpolate both shares at (N, 2 or 3) points, clamped at the border."""
        place = ((points[:, :2] - self.origin) / self.step_m).T
        key, fill = (map_coordinates(s, place, order=1, mode="nearest") for s in self.shares)
        return key, fill


def ground_light(
    extent_m: tuple[float, float, float, float],
    blockers: list[Blocker],
    light: Light,
    step_m: float = 0.05,
) -> LightMap:
    """Bake the ground z = 0 over x_min, y_min, x_max, y_max."""
    x = np.arange(extent_m[0], extent_m[2] + step_m, step_m)
    y = np.arange(extent_m[1], extent_m[3] + step_m, step_m)
    grid = np.stack(np.meshgrid(x, y, [1e-4], indexing="ij"), axis=-1).reshape(-1, 3)
    shares = np.stack([visibility(grid, blockers, light), occlusion(grid, blockers)])
    return LightMap(np.array(extent_m[:2]), step_m, shares.reshape(2, len(x), len(y)))
