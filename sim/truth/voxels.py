"""Occupancy of the static world, in voxels, from its geometry."""

import numpy as np
from scipy import ndimage

from scenes.scene import Kind
from sim.world.surfaces import drawn_surfaces, is_static
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.compilation import compiled
from vo.contract.errors import SettingsError

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""States of a cell, with the numbers of ROS' occupancy grids."""
MAX_VOXELS = 200_000_000
INSET = 1e-3
"""Distance in voxels from a surface to the points, inside of it, that mark it."""


def occupied_voxels(world: World, low: Array, high: Array, side_m: float) -> Mask:
    """Find which voxels between two corners (3,) of the world are occupied, (Z, Y, X).

    A voxel is occupied if a static surface passes through it, or its centre is inside a closed one
    or under the ground.

    Raises:
        SettingsError: If there are too many voxels, or none.
    """
    counts = np.ceil((high - low) / side_m - 1e-9).astype(np.int64)
    if not (counts > 0).all() or np.prod(counts.astype(float)) > MAX_VOXELS:
        size = " x ".join(map(str, counts))
        raise SettingsError(
            f"resolution {side_m:g} m: {size} voxels; expected 1 to {MAX_VOXELS:,} of them"
        )
    nx, ny, nz = (int(x) for x in counts)
    grid = np.zeros((nz, ny, nx), np.bool_)
    poses = world.T_world_bodies
    for surface in drawn_surfaces(world):
        if is_static(world, surface):
            points = (se3.transform(poses[surface.body], surface.vertices) - low) / side_m
            _mark_surface(points[surface.triangles], grid)
            is_ground = surface.thing.kind == Kind.GROUND
            _fill(*_crossings(points[surface.triangles], nx, ny), is_ground, grid)
    return grid


def states(occupied: Mask, seeds: Indices) -> Array:
    """Return the state int8 of each cell of a grid of any number of dimensions.

    What is not occupied is free if it is connected, by faces, to one of the seeds (N, dimensions);
    cells that are not, such as those in a closed cupboard or beyond the walls, are unknown.
    """
    parts, _ = ndimage.label(~occupied)
    inside = ((seeds >= 0) & (seeds < occupied.shape)).all(axis=1)
    reached = np.unique(parts[tuple(seeds[inside].T)])
    is_free = np.isin(parts, reached[reached > 0])
    return np.where(occupied, OCCUPIED, np.where(is_free, FREE, UNKNOWN)).astype(np.int8)


@compiled()
def _mark_surface(triangles: Array, grid: Mask) -> None:
    """Mark the voxels that triangles (F, 3, 3), x, y, z in voxels, pass through; in place."""
    depth, height, width = grid.shape
    limits = np.array([width, height, depth], np.float64)
    for k in range(len(triangles)):
        a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
        outside = False
        for axis in range(3):
            lowest = min(a[axis], b[axis], c[axis])
            highest = max(a[axis], b[axis], c[axis])
            outside = outside or highest < 0 or lowest >= limits[axis]
        if outside:
            continue
        longest = np.sqrt(max(((b - a) ** 2).sum(), ((c - a) ** 2).sum(), ((c - b) ** 2).sum()))
        steps = int(np.ceil(2 * longest)) + 1  # points are at most half a voxel apart
        normal = np.cross(b - a, c - a)
        norm = np.sqrt((normal**2).sum())
        if norm > 0:  # what lies on the border of two voxels is of the one inside the surface
            a = a - INSET * normal / norm
            b, c = b - INSET * normal / norm, c - INSET * normal / norm
        for i in range(steps + 1):
            for j in range(steps + 1 - i):
                s, t = i / steps, j / steps
                x = int(np.floor(a[0] + s * (b[0] - a[0]) + t * (c[0] - a[0])))
                y = int(np.floor(a[1] + s * (b[1] - a[1]) + t * (c[1] - a[1])))
                z = int(np.floor(a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])))
                if 0 <= x < width and 0 <= y < height and 0 <= z < depth:
                    grid[z, y, x] = True


def _crossings(triangles: Array, width: int, height: int) -> tuple[Indices, Array, Array]:
    """Find where the vertical lines through the columns' centres cross triangles (F, 3, 3).

    Returns:
        (K,) index of the column, y times width plus x, the height of the crossing in voxels, and
        1 where the surface faces up, -1 where it faces down; by column, from the highest.
    """
    found = _cross(triangles, width, height, np.zeros((0, 3)))
    rows = np.zeros((found, 3))
    _cross(triangles, width, height, rows)
    order = np.lexsort((rows[:, 2], -rows[:, 1], rows[:, 0]))
    column, z, facing = rows[order].T
    return column.astype(np.int64), z, facing


@compiled()
def _cross(triangles: Array, width: int, height: int, out: Array) -> int:
    """Count the crossings, and write as many (column, z, facing) as there are rows."""
    found = 0
    for k in range(len(triangles)):
        a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0:
            continue
        x0 = max(int(np.ceil(min(a[0], b[0], c[0]) - 0.5)), 0)
        x1 = min(int(np.ceil(max(a[0], b[0], c[0]) - 0.5)), width)
        y0 = max(int(np.ceil(min(a[1], b[1], c[1]) - 0.5)), 0)
        y1 = min(int(np.ceil(max(a[1], b[1], c[1]) - 0.5)), height)
        for y in range(y0, y1):
            for x in range(x0, x1):
                u, v = x + 0.5, y + 0.5
                s = ((u - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (v - a[1])) / area
                t = ((b[0] - a[0]) * (v - a[1]) - (u - a[0]) * (b[1] - a[1])) / area
                if s >= 0 and t >= 0 and s + t < 1:
                    if found < len(out):
                        out[found, 0] = y * width + x
                        out[found, 1] = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
                        out[found, 2] = 1.0 if area > 0 else -1.0
                    found += 1
    return found


@compiled()
def _fill(columns: Indices, heights: Array, facing: Array, is_ground: bool, grid: Mask) -> None:
    """Fill, in place, between faces up and the faces down beneath that close them.

    A face up that nothing closes, such as the top of a sheet, fills nothing, except the ground.
    """
    depth, _, width = grid.shape
    open_faces, top = 0, 0.0
    for k in range(len(columns)):
        if k == 0 or columns[k] != columns[k - 1]:
            open_faces = 0
        if facing[k] > 0:
            top = heights[k] if open_faces == 0 else top
            open_faces += 1
        elif open_faces > 0:
            open_faces -= 1
        is_last = k + 1 == len(columns) or columns[k + 1] != columns[k]
        closes = facing[k] < 0 and open_faces == 0
        buried = is_ground and is_last and open_faces > 0
        if closes or buried:
            bottom = 0.0 if buried else heights[k]
            y, x = columns[k] // width, columns[k] % width
            for z in range(max(int(np.ceil(bottom - 0.5)), 0), depth):
                if z + 0.5 > top:
                    break
                grid[z, y, x] = True
