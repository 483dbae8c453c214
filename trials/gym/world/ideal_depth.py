"""Ideal disparity by ray casting in place of a stereo pair, to study planning alone."""

import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP, LABEL_GROUP
from sim.world.rover import BODY
from sim.world.world import World
from vo.contract.arrays import Array

WIDTH_PX, HEIGHT_PX = 64, 48
MAX_DISTANCE_M = 8.0


def ray_disparity(world: World) -> Array:
    """(HEIGHT_PX, WIDTH_PX) disparity in pixels of the full image; 0 where nothing is near.

    Rays meet collision shapes alone; pixels that the rover hides are unknown.
    """
    world.place_bodies()
    rig, model = world.rig, world.model
    u = (np.arange(WIDTH_PX) + 0.5) * rig.width_px / WIDTH_PX - 0.5
    v = (np.arange(HEIGHT_PX) + 0.5) * rig.height_px / HEIGHT_PX - 0.5
    x, y = np.meshgrid((u - rig.cx_px) / rig.f_px, (v - rig.cy_px) / rig.f_px)
    rays_cam = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    lengths = np.linalg.norm(rays_cam, axis=1)
    T_world_cam = world.T_world_cam
    rays = (rays_cam / lengths[:, None]) @ T_world_cam[:3, :3].T
    collides = np.ones(6, np.uint8)
    collides[[IMAGE_GROUP, LABEL_GROUP]] = 0
    geoms, distances_m = np.full(len(rays), -1, np.int32), np.zeros(len(rays))
    mujoco.mj_multiRay(
        model, world.data, T_world_cam[:3, 3], rays.ravel(), collides, 1, model.body(BODY).id,
        geoms, distances_m, None, len(rays), MAX_DISTANCE_M,
    )  # fmt: skip
    is_rover = model.body_rootid[model.geom_bodyid[geoms]] == model.body(BODY).rootid[0]
    depth_m = np.where((geoms >= 0) & ~is_rover, distances_m / lengths, np.inf)
    return (rig.f_px * rig.baseline_m / depth_m).reshape(HEIGHT_PX, WIDTH_PX)
