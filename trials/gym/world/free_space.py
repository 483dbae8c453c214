"""Free space: where the rover can be, from the shapes that can touch it."""

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
MOST_CELLS = 400
"""Along the longer side; larger worlds have larger cells."""
CLIMBED_M = 0.05
"""What reaches no higher above the ground is driven over."""
HEADROOM_M = 0.1
"""Above the cameras."""
NOTHING = -1


@dataclass(frozen=True)
class FreeSpace:
    """A grid over the extent of a world; row 0 has the smallest y, column 0 the smallest x.

    Attributes:
        origin: (2,) world x, y of the centre of cell (0, 0), metres.
        cell_m: Side of a cell.
        obstacles: (H, W) geom that stands there, or NOTHING; what moves by itself is not in it.
        room_m: (H, W) distance to the nearest obstacle, or to the edge of the world.
        names: Of all geoms.
    """

    origin: Array
    cell_m: float
    obstacles: Indices
    room_m: Array
    names: tuple[str, ...]

    def cells(self, points: Array) -> Indices:
        """(..., 2) row and column of world points (..., 2); may lie outside."""
        return np.floor((points - self.origin) / self.cell_m + 0.5).astype(np.int64)[..., ::-1]

    def points(self, cells: Array) -> Array:
        """(..., 2) world x, y of the centres of cells (..., 2), row and column."""
        return self.origin + np.asarray(cells)[..., ::-1] * self.cell_m

    def inside(self, cells: Indices) -> Mask:
        """(...,) whether cells (..., 2) are on the grid."""
        return np.all((cells >= 0) & (cells < self.obstacles.shape), axis=-1)

    def nearest(self, point: Array) -> tuple[str, float]:
        """Name of the obstacle next to a world point (2,), and its distance in metres."""
        rows, columns = np.nonzero(self.obstacles != NOTHING)
        if len(rows) == 0:
            return "the edge of the world", math.inf
        away_m = np.linalg.norm(self.points(np.column_stack([rows, columns])) - point, axis=1)
        k = int(np.argmin(away_m))
        return self.names[self.obstacles[rows[k], columns[k]]], float(away_m[k])


def survey_free_space(world: World, height_m: float) -> FreeSpace:
    """Draw the outlines of all obstacles, as seen from above.

    Args:
        world: With bodies placed.
        height_m: Of the rover above the ground.
    """
    x_min, y_min, x_max, y_max = world.scene.extent_m
    cell_m = max(CELL_M, max(x_max - x_min, y_max - y_min) / MOST_CELLS)
    shape = math.ceil((y_max - y_min) / cell_m), math.ceil((x_max - x_min) / cell_m)
    origin = np.array([x_min, y_min]) + cell_m / 2
    grid = np.full(shape, NOTHING, np.int32)
    for geom in np.flatnonzero(standing(world)):
        outline = _outline(world, int(geom), height_m)
        if outline is not None:
            scaled = np.round((outline - origin) / cell_m * 16).astype(np.int32)
            cv2.fillConvexPoly(grid, cv2.convexHull(scaled), int(geom), cv2.LINE_8, 4)
    open_cells = np.pad((grid == NOTHING).astype(np.uint8), 1)  # the edge is an obstacle too
    room = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    room_m = np.maximum(room - 0.5, 0) * cell_m
    names = tuple(thing_of(world, k).name for k in range(world.model.ngeom))
    return FreeSpace(origin, cell_m, grid.astype(np.int64), room_m, names)


def standing(world: World) -> Mask:
    """(ngeom,) what stands in the way and does not move by itself."""
    model = world.model
    bodies = model.geom_bodyid
    return solid(world) & (model.body_mocapid[model.body_rootid[bodies]] < 0)


def hard(world: World) -> Mask:
    """(ngeom,) what must not be touched: obstacles that do not give way."""
    model = world.model
    bodies = model.geom_bodyid
    gives_way = (model.body_weldid[bodies] != 0) & (
        model.body_mocapid[model.body_rootid[bodies]] < 0
    )
    return solid(world) & ~gives_way


def solid(world: World) -> Mask:
    """(ngeom,) what the rover can bump into: not part of it, no ground and not driven over."""
    model = world.model
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    touches &= model.body_rootid[model.geom_bodyid] != model.body(BODY).rootid[0]
    flat = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD
    touches &= ~np.isin(model.geom_type, flat)
    for geom in np.flatnonzero(touches):
        corners = _corners(world, int(geom))
        above_m = corners[:, 2] - world.scene.elevation(corners[:, :2])
        is_ground = thing_of(world, int(geom)).kind is Kind.GROUND
        touches[geom] = not is_ground and above_m.max() > CLIMBED_M
    return touches


def _outline(world: World, geom: int, height_m: float) -> Array | None:
    """(N, 2) points whose hull is a geom from above; None if it is out of the rover's reach."""
    corners = _corners(world, geom)
    above_m = corners[:, 2] - world.scene.elevation(corners[:, :2])
    return corners[:, :2] if above_m.min() < height_m + HEADROOM_M else None


def _corners(world: World, geom: int) -> Array:
    """(N, 3) world points whose hull holds a geom, tightly where it is a box or a mesh."""
    model, data = world.model, world.data
    size, kind = model.geom_size[geom], mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = model.mesh_vert[first : first + count]
    elif kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
        turn = np.linspace(0, 2 * math.pi, 16, endpoint=False)
        circle = size[0] * np.column_stack([np.cos(turn), np.sin(turn)])
        half = size[1] + (size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0)
        local = np.vstack([np.column_stack([circle, np.full(16, z)]) for z in (-half, half)])
    else:
        signs = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T
        local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
