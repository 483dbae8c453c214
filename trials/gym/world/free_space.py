"""Free space of a world, and the distance field of the shortest paths through it to one goal.

Obstacles are the shapes that the rover can touch. Paths on the grid are shortened by line-of-sight
checks.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import mujoco
import numpy as np
from scipy.ndimage import distance_transform_edt

from scenes.scene import Kind
from sim.world.rover import BODY
from sim.world.world import World, thing_of
from trials.gym.world.grid_search import grid_distances, grid_path, is_clear_line
from trials.gym.world.ground import CLIMBABLE_M, NO_GEOM, NO_GROUND, ground_extent, map_ground
from vo.contract.arrays import Array, Indices, Mask

CELL_M = 0.05
MAX_CELLS = 400
"""Cells along the longer side; larger worlds have larger cells."""
HEADROOM_M = 0.1
"""Free height above the cameras that the rover needs to drive under a thing."""


@dataclass(frozen=True)
class FreeSpace:
    """A grid over the extent of a world; row 0 has the smallest y, column 0 the smallest x.

    Attributes:
        origin: (2,) world x, y of the centre of cell (0, 0), metres.
        cell_m: Side of a cell.
        obstacles: (H, W) geom that stands in each cell, NO_GEOM, or NO_GROUND; moving things are
            left out.
        clearance_m: (H, W) distance to the nearest obstacle or to the edge of ground or world.
        is_drawn: (H, W) whether the ground is drawn, so that trials begin and end there.
        is_level: (H, W) whether it is as high as the scene states, so that the rover can be placed.
        names: Names of all geoms.
    """

    origin: Array
    cell_m: float
    obstacles: Indices
    clearance_m: Array
    is_drawn: Mask
    is_level: Mask
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
        geom = int(self.obstacles[rows[k], columns[k]])
        name = "the end of the ground" if geom == NO_GROUND else self.names[geom]
        return name, float(distances_m[k])


def map_free_space(world: World, height_m: float, cell_m: float | None = None) -> FreeSpace:
    """Draw the outlines of all obstacles that a rover of a height can touch, from above.

    Cells have CELL_M, or more in a large world, unless their side is given.
    """
    extent, below = np.array(world.scene.extent_m), ~obstacle_geoms(world)
    if world.scene.source and max(extent[2:] - extent[:2]) > MAX_CELLS * CELL_M:
        extent = np.array(ground_extent(world, below))  # not what only stands far away
    x_min, y_min, x_max, y_max = extent.tolist()
    if cell_m is None:
        cell_m = max(CELL_M, max(x_max - x_min, y_max - y_min) / MAX_CELLS)
    shape = math.ceil((y_max - y_min) / cell_m), math.ceil((x_max - x_min) / cell_m)
    origin = np.array([x_min, y_min]) + cell_m / 2
    grid = np.full(shape, NO_GEOM, np.int32)
    for geom in np.flatnonzero(static_geoms(world)):
        corners, heights_m = _corners(world, int(geom))
        if heights_m.min() < height_m + HEADROOM_M:
            scaled = np.round((corners[:, :2] - origin) / cell_m * 16).astype(np.int32)
            cv2.fillConvexPoly(grid, cv2.convexHull(scaled), int(geom), cv2.LINE_8, 4)
    is_drawn = is_level = np.ones(shape, bool)
    if world.scene.source:  # the ground of a user's world may end
        points = origin + np.moveaxis(np.indices(shape)[::-1], 0, -1) * cell_m
        ends, is_drawn, is_level = map_ground(world, points, cell_m, below)
        grid = np.where(grid == NO_GEOM, ends, grid)
    open_cells = np.pad((grid == NO_GEOM).astype(np.uint8), 1)  # the edge is an obstacle too
    distance = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    clearance_m = np.maximum(distance - 0.5, 0) * cell_m
    names = tuple(thing_of(world, k).name for k in range(world.model.ngeom))
    return FreeSpace(origin, cell_m, grid.astype(np.int64), clearance_m, is_drawn, is_level, names)


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
    """World points (N, 3) whose hull holds a geom, and their heights (N,) above the ground, metres.

    The hull is tight where the geom is a box or a mesh.
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


@dataclass(frozen=True)
class TraversableSpace:
    """Where the rover's axle keeps a clearance from obstacles, and which places are connected."""

    space: FreeSpace
    min_clearance_m: float

    @cached_property
    def mask(self) -> Mask:
        """(H, W) cells with enough clearance."""
        return self.space.clearance_m >= self.min_clearance_m

    @cached_property
    def components(self) -> Indices:
        """(H, W) number of the connected component of each cell; 0 without clearance."""
        _, components = cv2.connectedComponents(self.mask.astype(np.uint8), connectivity=4)
        return np.asarray(components, np.int64)

    def distance_field(self, goal: Array) -> "DistanceField":
        """Find the shortest paths from everywhere to a traversable world point (2,)."""
        return DistanceField(self, goal, self.distances_m(goal))

    def distances_m(self, point: Array, limit_m: float = math.inf) -> Array:
        """Find how far it is to a traversable world point (2,), (H, W); infinite beyond a limit."""
        row, column = self.space.cells(point).tolist()
        return grid_distances(self.mask, row, column, self.space.cell_m, limit_m)

    def shortest_path(self, start: Array, goal: Array) -> Array | None:
        """(N, 2) shortest path between two traversable points (2,); None if there is none."""
        field = self.distance_field(goal)
        if not np.isfinite(field.distances_m[tuple(self.space.cells(start))]):
            return None
        return field.path_from(start)

    def has_line(self, a: Array, b: Array) -> bool:
        """Whether the straight line between world points (2,) is traversable."""
        space = self.space
        points = max(2, int(np.linalg.norm(b - a) / (0.5 * space.cell_m)) + 1)
        return bool(is_clear_line(self.mask, space.origin, space.cell_m, a, b, points))


@dataclass(frozen=True)
class DistanceField:
    """Shortest paths to one goal.

    Attributes:
        traversable: Space that the paths lead through.
        goal: (2,) world x, y.
        distances_m: (H, W) from each cell along the grid; infinite where there is no path.
    """

    traversable: TraversableSpace
    goal: Array
    distances_m: Array

    def distance_m(self, point: Array) -> float:
        """Length of the path from a world point (2,), at least the straight distance.

        From a cell without path it is that of the nearest cell with one, plus the detour.
        """
        space = self.traversable.space
        row, column = np.clip(space.cells(point), 0, np.array(self.distances_m.shape) - 1)
        straight = float(np.linalg.norm(self.goal - point))
        length = float(self.distances_m[row, column])
        if not np.isfinite(length):
            row, column = self._nearest_known[:, row, column]
            detour = float(np.linalg.norm(space.points(np.array([row, column])) - point))
            length = float(self.distances_m[row, column]) + detour
        return max(length, straight)

    @cached_property
    def _nearest_known(self) -> Indices:
        """(2, H, W) nearest cell that has a path."""
        unknown = ~np.isfinite(self.distances_m)
        indices = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        return np.asarray(indices, np.int64)

    def path_from(self, point: Array) -> Array:
        """(N, 2) waypoints from a traversable world point (2,), shortened; N >= 2."""
        traversable, space = self.traversable, self.traversable.space
        row, column = space.cells(point).tolist()
        cells = grid_path(traversable.mask, self.distances_m, row, column, space.cell_m)
        path = np.vstack([point, space.points(cells[1:-1]), self.goal])
        has_line = traversable.has_line
        shortened = [path[0]]
        k = 0
        while k < len(path) - 1:
            ahead = len(path) - 1
            while ahead > k + 1 and not has_line(path[k], path[ahead]):
                ahead = k + max(1, (ahead - k) // 2)
            while ahead + 1 < len(path) and has_line(path[k], path[ahead + 1]):
                ahead += 1
            shortened.append(path[ahead])
            k = ahead
        return np.array(shortened)


def path_length_m(path: Array) -> float:
    """Length of a polyline (N, 2)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
