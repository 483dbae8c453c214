"""Point clouds of the static world: fused from depth images, or sampled from its surfaces."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.scene import Kind
from sim.labels.views import View
from sim.preview.colours import rgb_of
from sim.preview.label_plates import object_colours
from sim.world.surfaces import drawn_surfaces, is_static
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix
from vo.contract.ply import write_ply

CELLS_MAX = 1 << 20
"""Largest distance of a voxel from the origin along an axis, in voxels."""
KEY = np.array([1 << 42, 1 << 21, 1])
"""Weights that make one number of a voxel's three."""


@dataclass(frozen=True, repr=False, eq=False)
class PointCloud:
    """N points in the world.

    Attributes:
        points_world: (N, 3) float64 metres, z up.
        colours: (N, 3) uint8 RGB.

    Example:
        >>> cloud = dy.point_cloud(ds, voxel_m=0.1)
        >>> cloud.points_world.shape == cloud.colours.shape
        True
        >>> cloud.save("cloud.ply").stat().st_size > 15 * len(cloud.points_world)
        True
    """

    points_world: Array
    colours: Image

    def save(self, path: Path | str) -> Path:
        """Write a binary `.ply` with positions, float32 metres, and colours; return its path.

        Raises:
            SettingsError: If the name has another suffix.
            DatasetError: If the file cannot be written.
        """
        out = Path(path)
        known_suffix(out, (".ply",))
        columns = [(axis, "<f4") for axis in "xyz"]
        columns += [(channel, "u1") for channel in ("red", "green", "blue")]
        table = np.zeros(len(self.points_world), np.dtype(columns))
        for k, axis in enumerate("xyz"):
            table[axis] = self.points_world[:, k]
        for k, channel in enumerate(("red", "green", "blue")):
            table[channel] = self.colours[:, k]
        write_ply(out, table)
        return out

    def __repr__(self) -> str:
        return f"PointCloud({len(self.points_world):,} points)"


def fuse_depth(
    views: Iterable[tuple[View, Image]], voxel_m: float, max_depth_m: float
) -> PointCloud:
    """Fuse the pixels of views with images (H, W[, 3]), without the sky and what moves.

    Points and colours are means over the cubes with sides of `voxel_m` that they are in.
    """
    keys, sums = np.zeros(0, np.int64), np.zeros((0, 7))
    for view, image in views:
        used = view.depth_m < max_depth_m
        if view.kind_of is not None:
            used &= view.kind_of[view.numbers] != Kind.MOVING
        v, u = np.nonzero(used)
        z = view.depth_m[used].astype(float)
        rays = np.column_stack([view.rig.normalized(np.column_stack([u, v])), np.ones(len(z))])
        world = se3.transform(view.T_world_cam, rays * z[:, None])
        rows = np.column_stack([world, rgb_of(image)[used], np.ones(len(z))])
        cells = np.floor(world / voxel_m).astype(np.int64)
        if np.abs(cells).max(initial=0) >= CELLS_MAX:
            raise SettingsError(f"voxel_m {voxel_m:g}: too small for a world of this size")
        keys, where = np.unique(
            np.concatenate([keys, (cells + CELLS_MAX) @ KEY]), return_inverse=True
        )
        rows = np.concatenate([sums, rows])
        sums = np.stack([np.bincount(where, column, len(keys)) for column in rows.T], axis=-1)
    means = sums[:, :6] / sums[:, 6:]
    return PointCloud(means[:, :3], np.rint(means[:, 3:]).astype(np.uint8))


def sample_surfaces(world: World, per_m2: float, rng: np.random.Generator) -> PointCloud:
    """Sample points from what is static and drawn, evenly by area, coloured by object.

    Planes are cut off at the extent of the scene.
    """
    clouds: list[tuple[Array, Indices]] = []
    names: dict[str, int] = {}
    x_min, y_min, x_max, y_max = world.scene.extent_m
    for surface in drawn_surfaces(world):
        if not is_static(world, surface):
            continue
        corners = se3.transform(world.T_world_bodies[surface.body], surface.vertices)
        a, b, c = corners[surface.triangles].transpose(1, 0, 2)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        count = rng.poisson(per_m2 * areas.sum())
        k = np.searchsorted(np.cumsum(areas), areas.sum() * rng.random(count))
        s, t = rng.random((2, count, 1))
        s, t = np.where(s + t > 1, (1 - s, 1 - t), (s, t))
        points = a[k] + s * (b - a)[k] + t * (c - a)[k]
        inside = (points[:, :2] >= (x_min, y_min)) & (points[:, :2] <= (x_max, y_max))
        points = points[inside.all(axis=1)]
        number = names.setdefault(surface.thing.name, len(names) + 1)
        clouds.append((points, np.full(len(points), number)))
    points = np.concatenate([np.zeros((0, 3)), *(x for x, _ in clouds)])
    numbers = np.concatenate([np.zeros(0, np.int64), *(x for _, x in clouds)])
    colours = object_colours(numbers[None])[0][0] if len(numbers) else np.zeros((0, 3), np.uint8)
    return PointCloud(points, colours)
