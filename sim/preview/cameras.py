"""Cameras of the previews: one behind the carrier, and an orthographic one above the scene."""

import math
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from scenes.scene import COLLISION_GROUP, IMAGE_GROUP
from sim.camera.render import BOTH_GROUPS, StereoRenderer
from sim.world.rover import BODY
from sim.world.world import World
from vo.contract.arrays import Array, Image, Indices
from vo.contract.dataset import MAP_FILE

DISTANCE_M = 2.1
CLOSEST_M = 0.7
ELEVATION_DEG = 24.0
SIDE_DEG = 24.0
OFF_SURFACE_M = 0.08

LONG_SIDE_PX = 1024
CAMERA_ABOVE_M = 30.0
HEADROOM_M = 0.6
"""Height above the ground below which nothing counts as a ceiling."""
PROBES = 40
COVERED_SHARE = 0.2
"""Fraction of the path under a roof from which there is a ceiling."""
CEILING_THICK_M = 0.5
"""Depth below the lowest ceiling point from which a geom is no ceiling alone."""
UNDER_CEILING_M = 0.1
BORDER_M = 0.5


def chase_camera(world: World, side_deg: float | None = None) -> mujoco.MjvCamera:
    """Place a camera `side_deg` to the right of straight behind the carrier; None: most space."""
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
    carrier = world.model.body(BODY).rootid[0]
    free_m, start = 0.0, lookat.copy()
    while free_m < DISTANCE_M:  # through the carrier itself
        step_m, geom = _cast_ray(world, start, back)
        if step_m < 0:
            return DISTANCE_M
        free_m += step_m
        if world.model.body_rootid[world.model.geom_bodyid[geom]] != carrier:
            break
        free_m += 1e-3
        start += (step_m + 1e-3) * back
    return min(free_m - OFF_SURFACE_M, DISTANCE_M)


@dataclass(frozen=True)
class TopDownMap:
    """An image (H, W, 3) with x to the right and y up, and its position and scale in the world.

    `x_min_m` and `y_max_m` are of the outer edges of the leftmost and topmost pixels.
    """

    image: Image
    x_min_m: float
    y_max_m: float
    metres_per_px: float

    @property
    def manifest_entry(self) -> dict[str, Any]:
        """JSON-ready description for the manifest."""
        return {
            "file": MAP_FILE,
            "x_min_m": self.x_min_m,
            "y_max_m": self.y_max_m,
            "metres_per_px": self.metres_per_px,
            "world_to_pixel": "u = (x - x_min_m) / metres_per_px - 0.5; "
            "v = (y_max_m - y) / metres_per_px - 0.5",
        }

    def pixels(self, points_world: Array) -> Array:
        """Map (..., 2 or 3) world points in metres to (..., 2) (u, v), centres on integers."""
        u = (points_world[..., 0] - self.x_min_m) / self.metres_per_px - 0.5
        v = (self.y_max_m - points_world[..., 1]) / self.metres_per_px - 0.5
        return np.stack([u, v], axis=-1)


def render_map(
    renderer: StereoRenderer,
    extent_m: tuple[float, float, float, float],
    below_m: float = CAMERA_ABOVE_M,
) -> TopDownMap:
    """Render an extent (x_min, y_min, x_max, y_max in world metres) of the scene from above.

    Geoms above the camera, at height `below_m`, are not shown.
    """
    x_min, y_min, x_max, y_max = extent_m
    scale = max(x_max - x_min, y_max - y_min) / LONG_SIDE_PX
    width, height = (round(side / scale) for side in (x_max - x_min, y_max - y_min))
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    # Whole pixels: the lower and right edges may reach a little past the extent.
    camera.lookat = (x_min + width * scale / 2, y_max - height * scale / 2, 0.0)
    camera.distance, camera.azimuth, camera.elevation = below_m, 90.0, -90.0
    image = renderer.render_view(camera, width, height, orthographic_m=height * scale)
    return TopDownMap(image, x_min, y_max, scale)


def render_world_map(world: World, renderer: StereoRenderer) -> TopDownMap:
    """Render the whole world from above, as placed, without its ceiling."""
    with ceiling_hidden(world):
        return render_map(renderer, shown_extent(world), _below_ceiling_m(world))


def shown_extent(world: World) -> tuple[float, float, float, float]:
    """Return the scene's extent, as `Scene.extent_m`, enlarged by all routes and the path."""
    x_min, y_min, x_max, y_max = world.scene.extent_m
    ways = [world.path.waypoints, *world.scene.routes.values()]
    low = np.min([(x_min, y_min), *(way.min(axis=0) - BORDER_M for way in ways)], axis=0)
    high = np.max([(x_max, y_max), *(way.max(axis=0) + BORDER_M for way in ways)], axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


@contextmanager
def ceiling_hidden(world: World) -> Generator[None]:
    """Hide geoms at the height of the ceiling, if the path has one; walls stay."""
    model, data = world.model, world.data
    groups = model.geom_group.copy()
    heights, geoms = _overhead(world)
    half = np.abs(data.geom_xmat.reshape(-1, 3, 3)) @ model.geom_aabb[:, 3:, None]
    middle = data.geom_xmat.reshape(-1, 3, 3) @ model.geom_aabb[:, :3, None]
    lowest_m = data.geom_xpos[:, 2] + (middle - half)[:, 2, 0]
    lids = np.unique(geoms[geoms >= 0])
    lids = lids[lowest_m[lids] > float(heights.min()) - CEILING_THICK_M]
    if np.mean(geoms >= 0) > COVERED_SHARE and len(lids):
        bounded = model.geom_rbound > 0
        model.geom_group[bounded & (lowest_m >= lowest_m[lids].min() - 1e-6)] = COLLISION_GROUP
    try:
        yield
    finally:
        model.geom_group[:] = groups


def _below_ceiling_m(world: World) -> float:
    """Return a height below the ceiling that is joined to walls."""
    heights, geoms = _overhead(world)
    if np.mean(geoms >= 0) <= COVERED_SHARE:
        return CAMERA_ABOVE_M
    return float(np.median(heights[geoms >= 0])) - UNDER_CEILING_M


def _overhead(world: World) -> tuple[Array, Indices]:
    """Return heights in metres and ids of the lowest geoms above the path, -1 for none."""
    up = np.array([0.0, 0.0, 1.0])
    heights, geoms = np.full(PROBES, CAMERA_ABOVE_M), np.full(PROBES, -1)
    for k, along_m in enumerate(np.linspace(0, world.path.length_m, PROBES + 2)[1:-1]):
        xy = world.path.at(along_m)
        start = np.array([*xy, float(world.scene.elevation(xy)) + HEADROOM_M])
        room_m, geom = _cast_ray(world, start, up)
        if room_m >= 0:
            heights[k], geoms[k] = start[2] + room_m, geom
    return heights, geoms


def _cast_ray(world: World, start: Array, direction: Array) -> tuple[float, int]:
    """Return the distance to the first drawn geom and its id; -1 both if there is none."""
    groups, geom = np.zeros(6, np.uint8), np.full(1, -1, np.int32)
    groups[[*BOTH_GROUPS, IMAGE_GROUP]] = 1
    distance_m = mujoco.mj_ray(world.model, world.data, start, direction, groups, 1, -1, geom)
    return distance_m, int(geom[0])
