"""The ground of a user's world: where it ends, and which walls are planes."""

from copy import copy

import cv2
import mujoco
import numpy as np

from sim.world.start import ABOVE_M
from sim.world.world import World
from vo.contract.arrays import Array, Indices, Mask

NO_GEOM, NO_GROUND = -1, -2
CLIMBABLE_M = 0.05
"""Height above the ground up to which the rover drives over a thing."""
SLOPE_MAX = 0.47
"""Steepest slope, of 25 degrees."""
UPWARDS = 0.7
"""Vertical component of the normal from which a plane is ground, else a wall or a ceiling."""


def ground_extent(world: World, below: Mask) -> tuple[float, float, float, float]:
    """Return the part x, y, x, y of a scene's extent, metres, that may have ground."""
    model, data, carries = world.model, world.data, _carrying(world, below)
    if not carries.any():
        return world.scene.extent_m
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    reach = np.where(planes, np.hypot(*model.geom_size[:, :2].T), model.geom_rbound)
    reach[planes & (model.geom_size[:, :2] == 0).any(axis=1)] = np.inf
    low, high = (data.geom_xpos[:, :2] + s * reach[:, None] for s in (-1, 1))
    x_min, y_min, x_max, y_max = world.scene.extent_m
    x_low, y_low = np.maximum(low[carries].min(axis=0), (x_min, y_min))
    x_high, y_high = np.minimum(high[carries].max(axis=0), (x_max, y_max))
    return float(x_low), float(y_low), float(x_high), float(y_high)


def map_ground(
    world: World, points: Array, cell_m: float, below: Mask
) -> tuple[Indices, Mask, Mask]:
    """Find where the ground ends, on a grid of world points (H, W, 2) that are `cell_m` apart.

    It consists of the geoms `below` (ngeom,) and ends at steps that the rover cannot climb.

    Returns:
        (H, W) NO_GROUND, the plane that is a wall before it, or NO_GEOM where it does not end;
        whether it is drawn, where MuJoCo's planes have no end; and whether it is as high as the
        scene states.
    """
    model, data, flat = world.model, world.data, points.reshape(-1, 2)
    height_m = _heights(world, flat, below, True).reshape(points.shape[:2])
    is_drawn = ~np.isnan(_heights(world, flat, below, False)).reshape(points.shape[:2])
    around, filled = np.ones((3, 3), np.uint8), np.nan_to_num(height_m, nan=-ABOVE_M)
    step_m = cv2.dilate(filled, around) - cv2.erode(filled, around)
    no_ground = np.isnan(height_m) | (step_m > max(CLIMBABLE_M, 2 * SLOPE_MAX * cell_m))
    ends = np.where(no_ground, NO_GROUND, NO_GEOM)
    z = world.scene.elevation(flat) + np.nan_to_num(height_m).ravel()
    above = np.column_stack([flat, z + CLIMBABLE_M])
    solid = (model.geom_contype | model.geom_conaffinity) & 1 != 0
    for geom in np.flatnonzero(solid & (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)):
        distance_m = (above - data.geom_xpos[geom]) @ data.geom_xmat[geom, 2::3]
        ends[distance_m.reshape(ends.shape) < 0] = geom
    return ends, is_drawn, np.abs(height_m) <= CLIMBABLE_M


def _heights(world: World, points: Array, below: Mask, endless: bool) -> Array:
    """Return the height (N,) of the ground at points (N, 2) above what the scene states; or NaN.

    Planes are as large as they are drawn, or endless.
    """
    model, data, carries = world.model, world.data, _carrying(world, below)
    stated_m = np.broadcast_to(world.scene.elevation(points), len(points))
    top_m, near = np.full(len(points), -np.inf), np.zeros(len(points), bool)
    for geom in np.flatnonzero(carries):
        away_m = points - data.geom_xpos[geom, :2]
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            near |= np.hypot(*away_m.T) <= model.geom_rbound[geom]
            continue
        R, size = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom, :2]
        rise_m = -away_m @ R[:2, 2] / R[2, 2]
        place = np.abs(np.column_stack([away_m, rise_m]) @ R[:, :2])
        meets = data.geom_xpos[geom, 2] + rise_m <= stated_m + ABOVE_M
        meets &= ((place <= size) | (size == 0) | endless).all(axis=1)
        np.maximum(top_m, data.geom_xpos[geom, 2] + rise_m, out=top_m, where=meets)
    _raise_to_bodies(world, points, carries, stated_m, near, top_m)
    return np.where(np.isfinite(top_m), top_m - stated_m, np.nan)


def _raise_to_bodies(
    world: World, points: Array, carries: Mask, stated_m: Array, near: Mask, top_m: Array
) -> None:
    """Raise heights (N,) at points `near` geoms that are no planes to those, by rays."""
    if not near.any():
        return  # a copy of the model has all its textures
    model, geom = copy(world.model), np.full(1, -1, np.int32)
    model.geom_group[:], model.geom_matid[:], model.geom_rgba[:, 3] = ~carries, -1, 1.0
    model.geom_group[model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE] = 1
    down, group = np.array([0.0, 0.0, -1.0]), np.array([1, 0, 0, 0, 0, 0], np.uint8)
    for k in np.flatnonzero(near).tolist():
        above = np.array([*points[k], stated_m[k] + ABOVE_M])
        distance_m = mujoco.mj_ray(model, world.data, above, down, group, 1, -1, geom)
        if geom[0] >= 0:
            top_m[k] = max(top_m[k], above[2] - distance_m)


def _carrying(world: World, below: Mask) -> Mask:
    """Return which of the geoms `below` (ngeom,) stand still and carry wheels."""
    model = world.model
    walls = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    walls &= world.data.geom_xmat[:, 8] < UPWARDS
    is_solid = (model.geom_contype | model.geom_conaffinity) & 1 != 0
    return below & is_solid & ~walls & (model.body_weldid[model.geom_bodyid] == 0)
