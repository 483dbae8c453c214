"""Ideal depth: rays in place of a stereo pair, where only what is done with it is of interest."""

import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP, LABEL_GROUP
from sim.world.rover import BODY
from sim.world.world import World
from vo.contract.arrays import Array

WIDTH_PX, HEIGHT_PX = 64, 48
FARTHEST_M = 8.0


def ray_disparity(world: World) -> Array:
    """(HEIGHT_PX, WIDTH_PX) disparity in pixels of the full image; 0 where nothing is near.

    Rays meet what can be felt, and not what is only painted; what the rover hides is unknown.

    Args:
        world: At a moment; its bodies are placed.
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
    felt = np.ones(6, np.uint8)
    felt[[IMAGE_GROUP, LABEL_GROUP]] = 0
    geoms, away_m = np.full(len(rays), -1, np.int32), np.zeros(len(rays))
    mujoco.mj_multiRay(
        model, world.data, T_world_cam[:3, 3], rays.ravel(), felt, 1, model.body(BODY).id,
        geoms, away_m, None, len(rays), FARTHEST_M,
    )  # fmt: skip
    mine = model.body_rootid[model.geom_bodyid[geoms]] == model.body(BODY).rootid[0]
    depth_m = np.where((geoms >= 0) & ~mine, away_m / lengths, np.inf)
    return (rig.f_px * rig.baseline_m / depth_m).reshape(HEIGHT_PX, WIDTH_PX)
