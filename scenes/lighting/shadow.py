"""Shadow and ambient occlusion: the share of the lamps' light that passes the occluding boxes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from scenes.lighting.baked_light import Light
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.compilation import compiled

Table = tuple[Array, Array, Array, Array]
"""Boxes by column, see `occluder_table`."""

OCCLUSION_REACHES = 8
"""Beyond this multiple of its reach, a box dims the fill by less than 1e-10."""
MIN_CULLED_RAD = 0.1
"""Elevation of the lamp below which no box is culled: its shadows reach too far."""
TILE_M, TILED = 3.0, 1000
"""Side of the squares by which boxes are culled, and number of points that are worth it."""


@dataclass(frozen=True)
class Occluder:
    """A box of half sizes (3,) about a centre (3,), metres, turned about z, that casts shadows.

    The opacity is the share of light that it stops; less than 1 for foliage.
    """

    centre: Array
    half: Array
    yaw_rad: float = 0.0
    opacity: float = 1.0


def visibility(
    points: Array, occluders: list[Occluder], light: Light, samples: int = 6, inside: bool = False
) -> Array:
    """Compute the share (N,) of the key lamp that is visible from each of (N, 3) points in metres.

    The samples are rays over the lamp's disc. With `inside`, a box shades what is inside it: true
    for the ground, false for the parts of furniture, which lie inside their own boxes.
    """
    if not occluders:
        return np.ones(len(points))
    side = np.cross(light.key, [0, 0, 1.0] if abs(light.key[2]) < 0.99 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    up = np.cross(side, light.key)
    k = np.arange(samples)[:, None]
    radius = light.softness_rad * np.sqrt((k + 0.5) / samples)
    turn = k * np.pi * (3 - np.sqrt(5))  # sunflower: even cover of the disc
    rays = light.key + radius * (np.cos(turn) * side + np.sin(turn) * up)
    table, points = occluder_table(occluders), np.ascontiguousarray(points, dtype=np.float64)
    seen = np.empty(len(points))
    for near in _tiles(points):
        some = points[near]
        seen[near] = _unoccluded(some, rays, _shading(table, some, light), inside)
    return seen


def _tiles(points: Array) -> list[Indices]:
    """Divide (N, 3) points by squares of the plane; few remain together."""
    if len(points) < TILED:
        return [np.arange(len(points))]
    _, tiles = np.unique(np.floor(points[:, :2] / TILE_M), axis=0, return_inverse=True)
    order = np.argsort(tiles, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(tiles[order])) + 1)


def _shading(table: Table, points: Array, light: Light) -> Table:
    """Select the boxes whose shadows can fall on any of (N, 3) points, by a bound on height."""
    centres, halves = table[:2]
    lowest = np.arcsin(np.clip(light.key[2], -1, 1)) - light.softness_rad
    if lowest < MIN_CULLED_RAD:
        return table
    rise = centres[:, 2] + halves[:, 2] - points[:, 2].min()
    keep = (rise > 0) & (_gaps(centres, halves, points) < rise / np.tan(lowest))
    return _rows(table, keep)


def _rows(table: Table, keep: Mask) -> Table:
    centres, halves, turns, opacities = table
    return centres[keep], halves[keep], turns[keep], opacities[keep]


def _gaps(centres: Array, halves: Array, points: Array) -> Array:
    """Measure from the boxes' bounding circles to the bounding rectangle of (N, 3) points: (B,)."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    outside = np.maximum(np.maximum(low - centres[:, :2], centres[:, :2] - high), 0)
    return np.linalg.norm(outside, axis=1) - np.linalg.norm(halves[:, :2], axis=1)


def occluder_table(occluders: list[Occluder]) -> Table:
    """List centres (B, 3), half sizes (B, 3), cosine and sine of the yaw (B, 2), opacities (B,)."""
    yaw = np.array([b.yaw_rad for b in occluders])
    return (
        np.array([b.centre for b in occluders]),
        np.array([b.half for b in occluders]),
        np.column_stack([np.cos(yaw), np.sin(yaw)]),
        np.array([b.opacity for b in occluders]),
    )


@compiled()
def crossing(
    point: Array, ray: Array, centre: Array, half: Array, turn: Array
) -> tuple[float, float]:
    """Intersect a line with a box by the slab test; returns entry and exit in multiples of the ray.

    On a miss the exit is before the entry. `turn` is the cosine and sine of the box's yaw.
    """
    dx, dy = point[0] - centre[0], point[1] - centre[1]
    c, t = turn[0], turn[1]
    start = (c * dx + t * dy, c * dy - t * dx, point[2] - centre[2])
    along = (c * ray[0] + t * ray[1], c * ray[1] - t * ray[0], ray[2])
    enter, leave = -1e9, 1e9
    for axis in range(3):
        inverse = 1 / along[axis] if abs(along[axis]) > 1e-9 else 1e9
        near = (-half[axis] - start[axis]) * inverse
        far = (half[axis] - start[axis]) * inverse
        enter, leave = max(enter, min(near, far)), min(leave, max(near, far))
    return enter, leave


@compiled()
def _unoccluded(points: Array, rays: Array, table: Table, inside: bool) -> Array:
    """Average over (S, 3) rays the light left behind all boxes: (N,)."""
    centres, halves, turns, opacities = table
    seen = np.zeros(len(points))
    for n in range(len(points)):
        for s in range(len(rays)):
            left = 1.0
            for b in range(len(centres)):
                enter, leave = crossing(points[n], rays[s], centres[b], halves[b], turns[b])
                ahead = leave > 0 if inside else enter > -1e-3
                if leave > enter and ahead:
                    left *= 1 - opacities[b]
                    if left == 0:
                        break
            seen[n] += left / len(rays)
    return seen


def occlusion(
    points: Array, occluders: list[Occluder], reach_m: float = 0.5, inside: bool = False
) -> Array:
    """Compute the openness to the fill of (N, 3) points: (N,) in [0, 1], 1 far from all boxes.

    `inside` is as for `visibility`.
    """
    if not occluders:
        return np.ones(len(points))
    table = occluder_table(occluders)
    table = _rows(table, _gaps(table[0], table[1], points) < OCCLUSION_REACHES * reach_m)
    return _openness(np.ascontiguousarray(points, dtype=np.float64), table, reach_m, inside)


@compiled()
def _openness(points: Array, table: Table, reach_m: float, inside: bool) -> Array:
    """Multiply, over all boxes, what each leaves of the fill at its distance from (N, 3) points."""
    centres, halves, turns, opacities = table
    left = np.ones(len(points))
    for n in range(len(points)):
        for b in range(len(centres)):
            dx, dy = points[n, 0] - centres[b, 0], points[n, 1] - centres[b, 1]
            c, t = turns[b, 0], turns[b, 1]
            x = max(abs(c * dx + t * dy) - halves[b, 0], 0.0)
            y = max(abs(c * dy - t * dx) - halves[b, 1], 0.0)
            z = max(abs(points[n, 2] - centres[b, 2]) - halves[b, 2], 0.0)
            distance = np.sqrt(x * x + y * y + z * z)
            if inside or distance > 1e-3:
                left[n] *= 1 - 0.55 * opacities[b] * np.exp(-3 * distance / reach_m)
    return left


@dataclass(frozen=True)
class LightMap:
    """Key and fill shares (2, nx, ny) on the ground, on a grid and interpolated between.

    The origin (2,) is x, y of the first sample, metres.
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
    occluders: list[Occluder],
    light: Light,
    step_m: float = 0.05,
    elevation: Callable[[Array], Array] | None = None,
) -> LightMap:
    """Bake the ground over x_min, y_min, x_max, y_max in metres, at z = 0 without an elevation.

    `elevation` gives (...) heights in metres at (..., 2) x, y.
    """
    x = np.arange(extent_m[0], extent_m[2] + step_m, step_m)
    y = np.arange(extent_m[1], extent_m[3] + step_m, step_m)
    grid = np.stack(np.meshgrid(x, y, [1e-4], indexing="ij"), axis=-1).reshape(-1, 3)
    if elevation is not None:
        grid[:, 2] += elevation(grid[:, :2])
    key = visibility(grid, occluders, light, inside=True)
    shares = np.stack([key, occlusion(grid, occluders, inside=True)])
    return LightMap(np.array(extent_m[:2]), step_m, shares.reshape(2, len(x), len(y)))
