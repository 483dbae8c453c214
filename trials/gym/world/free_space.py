"""Grid of the obstacles of a world, from the shapes that the rover can touch."""

import math
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np

from scenes.scene import Kind
from sim.world.rover import BODY
from sim.world.world import World, thing_of
from vo.contract.arrays import Array, Indices, Mask

CELL_M = 0.05
MAX_CELLS = 400
"""Cells along the longer side; larger worlds have larger cells."""
CLIMBABLE_M = 0.05
"""Height above the ground up to which the rover drives over a thing."""
HEADROOM_M = 0.1
"""Free height above the cameras that the rover needs to drive under a thing."""
NO_GEOM = -1


@dataclass(frozen=True)
class FreeSpace:
    """A grid over the extent of a world; row 0 has the smallest y, column 0 the smallest x.

    Attributes:
        origin: (2,) world x, y of the centre of cell (0, 0), metres.
        cell_m: Side of a cell.
        obstacles: (H, W) geom that stands in each cell, or NO_GEOM; moving things are left out.
        clearance_m: (H, W) distance to the nearest obstacle or to the edge of the world.
        names: Names of all geoms.
    """

    origin: Array
    cell_m: float
    obstacles: Indices
    clearance_m: Array
    names: tuple[str, ...]

    def cells(self, points: Array) -> Indices:
        """(..., 2) row and column of world points (..., 2); may be outside the grid."""
        return np.floor((points - self.origin) / self.cell_m + 0.5).astype(np.int64)[..., ::-1]

    def points(self, cells: Array) -> Array:
        """(..., 2) world x, y of the centres of cells (..., 2), row and column."""
        return self.origin + np.asarray(cells)[..., ::-1] * self.cell_m

    def inside(self, cells: Indices) -> Mask:
        """(...,) whether cells (..., 2) are on the grid."""
        return np.all((cells >= 0) & (cells < self.obstacles.shape), axis=-1)

    def nearest(self, point: Array) -> tuple[str, float]:
        """Name of the obstacle nearest to a world point (2,), and its distance in metres."""
        rows, columns = np.nonzero(self.obstacles != NO_GEOM)
        if len(rows) == 0:
            return "the edge of the world", math.inf
        distances_m = np.linalg.norm(self.points(np.column_stack([rows, columns])) - point, axis=1)
        k = int(np.argmin(distances_m))
        return self.names[self.obstacles[rows[k], columns[k]]], float(distances_m[k])


def map_free_space(world: World, height_m: float) -> FreeSpace:
    """Draw the outlines of all obstacles that a rover of a height can touch, from above."""
    x_min, y_min, x_max, y_max = world.scene.extent_m
    cell_m = max(CELL_M, max(x_max - x_min, y_max - y_min) / MAX_CELLS)
    shape = math.ceil((y_max - y_min) / cell_m), math.ceil((x_max - x_min) / cell_m)
    origin = np.array([x_min, y_min]) + cell_m / 2
    grid = np.full(shape, NO_GEOM, np.int32)
    for geom in np.flatnonzero(static_geoms(world)):
        corners, heights_m = _corners(world, int(geom))
        if heights_m.min() < height_m + HEADROOM_M:
            scaled = np.round((corners[:, :2] - origin) / cell_m * 16).astype(np.int32)
            cv2.fillConvexPoly(grid, cv2.convexHull(scaled), int(geom), cv2.LINE_8, 4)
    open_cells = np.pad((grid == NO_GEOM).astype(np.uint8), 1)  # the edge is an obstacle too
    distance = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    clearance_m = np.maximum(distance - 0.5, 0) * cell_m
    names = tuple(thing_of(world, k).name for k in range(world.model.ngeom))
    return FreeSpace(origin, cell_m, grid.astype(np.int64), clearance_m, names)


def obstacle_geoms(world: World) -> Mask:
    """(ngeom,) what the rover can bump into: not itself, the ground or what it drives over."""
    model = world.model
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    touches &= model.body_rootid[model.geom_bodyid] != model.body(BODY).rootid[0]
    flat = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD
    touches &= ~np.isin(model.geom_type, flat)
    for geom in np.flatnonzero(touches):
        is_ground = thing_of(world, int(geom)).kind is Kind.GROUND
        touches[geom] = not is_ground and _corners(world, int(geom))[1].max() > CLIMBABLE_M
    return touches


def static_geoms(world: World) -> Mask:
    """(ngeom,) obstacles that the scene does not move."""
    return obstacle_geoms(world) & ~_moved_by_scene(world)


def rigid_geoms(world: World) -> Mask:
    """(ngeom,) obstacles that do not give way, which the rover must not touch."""
    gives_way = (world.model.body_weldid[world.model.geom_bodyid] != 0) & ~_moved_by_scene(world)
    return obstacle_geoms(world) & ~gives_way


def _moved_by_scene(world: World) -> Mask:
    """(ngeom,) geoms of mocap bodies, which the scene moves."""
    model = world.model
    return model.body_mocapid[model.body_rootid[model.geom_bodyid]] >= 0


def _corners(world: World, geom: int) -> tuple[Array, Array]:
    """World points whose hull holds a geom, and their heights above the ground.

    Returns:
        (N, 3) points, tight where the geom is a box or a mesh, and (N,) heights in metres.
    """
    model, data = world.model, world.data
    size, kind = model.geom_size[geom], mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = model.mesh_vert[first : first + count]
    elif kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
        angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        circle = size[0] * np.column_stack([np.cos(angles), np.sin(angles)])
        half = size[1] + (size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0)
        local = np.vstack([np.column_stack([circle, np.full(16, z)]) for z in (-half, half)])
    else:
        signs = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T
        local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    points = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return points, points[:, 2] - world.scene.elevation(points[:, :2])
