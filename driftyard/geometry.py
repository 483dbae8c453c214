"""Truth of objects and of the world's geometry: boxes, point clouds, occupancy."""

import math
import os
from pathlib import Path
from typing import Literal

import numpy as np

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.failures import in_one_family
from sim.batch import build
from sim.settings import RecordSettings
from sim.truth.boxes import Box
from sim.truth.clouds import PointCloud, fuse_depth, sample_surfaces
from sim.truth.occupancy import Occupancy
from sim.truth.voxels import occupied_voxels, states
from sim.world.rover import WHEEL_RADIUS_M
from sim.world.world import World, build_world
from trials.formats.recording import open_recording
from trials.gym.world.free_space import NO_GEOM, map_free_space
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.settings import amended, with_defaults

MAX_CELLS = 100_000_000


@in_one_family
def boxes(dataset: Dataset | PathLike, i: int) -> list[Box]:
    """Return boxes, in the image and in the world, of the objects that the left image i shows.

    The drive is simulated, and the frame's geometry rendered, again, which takes seconds at first.

    Raises:
        DatasetError: If the recording is not driftyard's, or cannot be simulated again.
        FrameIndexError: If there is no such frame.
        GraphicsError: If there is no OpenGL.

    Example:
        >>> sorted(x.name for x in dy.boxes(ds, 0) if x.kind == "ground")
        ['ground']
    """
    ds = dataset_of(dataset)
    return ds.views.boxes(ds.row(i))


@in_one_family
def point_cloud(
    source: Dataset | PathLike,
    of: Literal["depth", "surfaces"] = "depth",
    *,
    voxel_m: float = 0.02,
    max_depth_m: float = 10.0,
    per_m2: float = 1000.0,
    seed: int = 0,
) -> PointCloud:
    """Return the static world as points: what the frames saw, or all surfaces that are drawn.

    Args:
        source: An open recording, of which the chosen frames are used, or its folder; of surfaces
            also a scene, as for `record`.
        of: `depth` fuses the depth of all frames, with the colours of the images; `surfaces`
            samples the geometry, with a colour for each object.
        voxel_m: Side of the cubes in which points of `depth` are replaced by their mean, m.
        max_depth_m: Largest depth that is used, m.
        per_m2: Number of points of `surfaces` a square metre.
        seed: Of the places of the points of `surfaces`, and of a scene.

    Raises:
        SettingsError: If a value is not positive, or the scene is unknown.
        DatasetError: If the recording has no depth or poses, or its world cannot be built again.
        ImageError: If an image is damaged.

    Example:
        >>> dy.point_cloud("yard.xml", "surfaces", per_m2=100)
        PointCloud(... points)
    """
    numbers = {"voxel_m": voxel_m, "max_depth_m": max_depth_m, "per_m2": per_m2}
    _expect_positive(numbers)
    if of == "surfaces":
        return sample_surfaces(_world(source, seed), per_m2, np.random.default_rng(seed))
    if of != "depth":
        raise SettingsError(f"a point cloud of {of}; expected depth or surfaces")
    ds = dataset_of(source)
    views = ds.views
    images = open_recording(ds.path, ds.selection, needs_poses=False)
    with views.opened(not views.are_labelled) as view:
        pairs = ((view(k), images.pixels(k)[0]) for k in range(len(ds)))
        return fuse_depth(pairs, voxel_m, max_depth_m)


@in_one_family
def occupancy(
    source: Dataset | PathLike,
    resolution_m: float = 0.05,
    *,
    dimensions: Literal[2, 3] = 2,
    z_m: tuple[float, float] = (-0.1, 2.5),
    seed: int = 0,
) -> Occupancy:
    """Return which cells of the world are occupied, from its geometry, without what moves.

    In two dimensions, a cell is occupied if the rover can touch what stands there, or there is no
    ground, as the navigation trials define it. In three, if a drawn surface passes through it, or
    its centre is inside a closed surface or under the ground. What the carrier cannot reach
    through free cells, such as the inside of a cupboard or the outside of a room, is unknown.

    Args:
        source: An open recording, its folder, or a scene, as for `record`.
        resolution_m: Side of a cell, m.
        dimensions: 2 for cells of the ground, 3 for voxels.
        z_m: Lowest and highest z of voxels, m.
        seed: Of a scene.

    Raises:
        SettingsError: If a value is out of range, or the scene is unknown.
        DatasetError: If the recording is not driftyard's, or its world cannot be built again.

    Example:
        >>> dy.occupancy(ds, 0.1)
        Occupancy(... cells of 0.1 m, ...% occupied)
    """
    _expect_positive({"resolution_m": resolution_m, "height of z_m": z_m[1] - z_m[0]})
    world = _world(source, seed)
    height_m = float(world.rig.T_body_cam[2, 3]) + WHEEL_RADIUS_M
    ways = world.path.at(np.linspace(0, world.path.length_m, 200))
    if dimensions == 2:
        return _ground(world, height_m, resolution_m, ways)
    if dimensions != 3:
        raise SettingsError(f"dimensions {dimensions}; expected 2 or 3")
    x_min, y_min, x_max, y_max = world.scene.extent_m
    low, high = np.array([x_min, y_min, z_m[0]]), np.array([x_max, y_max, z_m[1]])
    occupied = occupied_voxels(world, low, high, resolution_m)
    heights = world.scene.elevation(ways) + height_m
    seeds = np.floor((np.column_stack([ways, heights]) - low) / resolution_m).astype(np.int64)
    return Occupancy(states(occupied, seeds[:, ::-1]), low, resolution_m)


def _ground(world: World, height_m: float, cell_m: float, ways: Array) -> Occupancy:
    """Return the cells of the ground, of which those connected to the route (N, 2) are free."""
    x_min, y_min, x_max, y_max = world.scene.extent_m
    count = (x_max - x_min) * (y_max - y_min) / cell_m**2
    if not count <= MAX_CELLS:
        raise SettingsError(
            f"resolution_m {cell_m:g}: {count:.2g} cells; expected up to {MAX_CELLS:,}"
        )
    space = map_free_space(world, height_m, cell_m)
    found = states(space.obstacles != NO_GEOM, space.cells(ways))
    return Occupancy(found, space.origin - cell_m / 2, cell_m)


def _world(source: Dataset | PathLike, seed: int) -> World:
    """Build the world of a recording, or of a scene, in its state at the start."""
    if isinstance(source, Dataset) or Path(source).is_dir():
        return dataset_of(source).views.world
    settings = amended(RecordSettings(), {"seed": seed})
    scene = build(os.fspath(source), settings)
    return build_world(scene, with_defaults(settings, scene.defaults))


def _expect_positive(numbers: dict[str, float]) -> None:
    for name, value in numbers.items():
        if not (value > 0 and math.isfinite(value)):
            raise SettingsError(f"{name} {value:g}: expected a positive number")
