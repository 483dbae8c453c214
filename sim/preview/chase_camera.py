"""The chase camera: a view from behind the carrier, in front of obstacles."""

import math

import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP
from sim.camera.render import BOTH_GROUPS
from sim.world.rover import BODY
from sim.world.world import World
from vo.contract.arrays import Array

DISTANCE_M = 2.1
CLOSEST_M = 0.7
ELEVATION_DEG = 24.0
SIDE_DEG = 24.0
OFF_SURFACE_M = 0.08


def chase_camera(world: World, side_deg: float | None = None) -> mujoco.MjvCamera:
    """Place a camera behind the carrier, along its heading.

    It is `side_deg` to the right of straight behind; None for the side with the most space.
    """
    T_world_body = world.T_world_body
    forward = T_world_body[:3, 0]
    lookat = 0.7 * T_world_body[:3, 3] + 0.3 * world.T_world_cam[:3, 3] + 0.25 * forward
    heading_deg = math.degrees(math.atan2(forward[1], forward[0]))
    sides = (SIDE_DEG, -SIDE_DEG, 0.0, 50.0, -50.0) if side_deg is None else (side_deg,)
    rooms = [_room_m(world, lookat, heading_deg + side) for side in sides]
    best = int(np.argmax(rooms))
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat, camera.distance = lookat, max(rooms[best], CLOSEST_M)
    camera.azimuth, camera.elevation = heading_deg + sides[best], -ELEVATION_DEG
    return camera


def _room_m(world: World, lookat: Array, azimuth_deg: float) -> float:
    """Return how far back the camera can move before a drawn geom is in the way."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(ELEVATION_DEG)
    flat = -math.cos(elevation)
    back = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    groups = np.zeros(6, np.uint8)
    groups[[*BOTH_GROUPS, IMAGE_GROUP]] = 1
    geom = np.zeros(1, np.int32)
    carrier = world.model.body(BODY).rootid[0]
    free_m, start = 0.0, lookat.copy()
    while free_m < DISTANCE_M:  # through the carrier itself
        step_m = mujoco.mj_ray(world.model, world.data, start, back, groups, 1, -1, geom)
        if step_m < 0:
            return DISTANCE_M
        free_m += step_m
        if world.model.body_rootid[world.model.geom_bodyid[geom[0]]] != carrier:
            break
        free_m += 1e-3
        start += (step_m + 1e-3) * back
    return min(free_m - OFF_SURFACE_M, DISTANCE_M)
