"""The ground of a user's world: where there is some, and which walls are planes."""

from collections.abc import Generator
from contextlib import contextmanager

import cv2
import mujoco
import numpy as np

from sim.world.start import ABOVE_M
from sim.world.world import World
from vo.contract.arrays import Array, Indices, Mask

CLIMBABLE_M = 0.05
"""Height above the ground up to which the rover drives over a thing."""
SLOPE_MAX = 0.47
"""Steepest slope, of 25 degrees."""
UPWARDS = 0.7
"""Vertical component of the normal from which a plane is ground, else a wall or a ceiling."""
LIFT_M = 0.05
"""Height above the ground at which planes stand in the way."""


def map_ground(
    world: World, points: Array, cell_m: float, below: Mask
) -> tuple[Mask, Indices, Mask]:
    """Find where the ground of a world ends, on a grid of points (H, W, 2) `cell_m` apart.

    A step that the rover cannot climb ends it too. `below` (ngeom,) are no obstacles.

    Returns:
        (H, W) whether it ends there, the plane that is a wall before it, or -1, and whether it is as
        high as the scene states.
    """
    flat, shape = points.reshape(-1, 2), points.shape[:2]
    height_m, around = _heights(world, flat, below), np.ones((3, 3), np.uint8)
    z = world.scene.elevation(flat) + np.nan_to_num(height_m)
    walls = _planes_before(world, np.column_stack([flat, z])).reshape(shape)
    height_m = height_m.reshape(shape)
    filled = np.nan_to_num(height_m, nan=-ABOVE_M)
    step_m = cv2.dilate(filled, around) - cv2.erode(filled, around)
    ends = np.isnan(height_m) | (step_m > max(CLIMBABLE_M, 2 * SLOPE_MAX * cell_m))
    return ends, walls, np.abs(height_m) <= CLIMBABLE_M


def _heights(world: World, points: Array, below: Mask) -> Array:
    """Return how high the ground is at world points (N, 2) above what the scene states, metres.

    It is the highest of the static geoms `below` (ngeom,) that carry wheels; NaN (N,) without one.
    """
    model, data = world.model, world.data
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    carries = ((model.geom_contype | model.geom_conaffinity) & 1 != 0) & below
    carries &= ~(planes & (data.geom_xmat[:, 8] < UPWARDS))
    carries &= model.body_weldid[model.geom_bodyid] == 0
    down, group = np.array([0.0, 0.0, -1.0]), np.array([1, 0, 0, 0, 0, 0], np.uint8)
    found, geom = np.full(len(points), np.nan), np.full(1, -1, np.int32)
    stated_m = np.broadcast_to(world.scene.elevation(points), len(points))
    with _in_group_0(model, carries):
        for k, (x, y) in enumerate(points.tolist()):
            above = np.array([x, y, stated_m[k] + ABOVE_M])
            distance_m = mujoco.mj_ray(model, data, above, down, group, 1, -1, geom)
            if geom[0] >= 0:
                found[k] = ABOVE_M - distance_m
    return found


def _planes_before(world: World, points: Array) -> Indices:
    """Return the plane that each point (N, 3) of the ground is behind, in its half-space, or -1."""
    model, data = world.model, world.data
    behind = np.full(len(points), -1)
    solid = (model.geom_contype | model.geom_conaffinity) & 1 != 0
    for geom in np.flatnonzero(solid & (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)):
        away = points - data.geom_xpos[geom]
        away[:, 2] += LIFT_M
        behind[away @ data.geom_xmat[geom, 2::3] < 0] = geom
    return behind


@contextmanager
def _in_group_0(model: mujoco.MjModel, geoms: Mask) -> Generator[None]:
    """Let rays meet these geoms alone, visible or not."""
    kept = model.geom_group.copy(), model.geom_matid.copy(), model.geom_rgba.copy()
    model.geom_group[:] = np.where(geoms, 0, 1)
    model.geom_matid[:], model.geom_rgba[:, 3] = -1, 1.0
    try:
        yield
    finally:
        model.geom_group[:], model.geom_matid[:], model.geom_rgba[:] = kept
