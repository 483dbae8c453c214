"""Exposure: sub-frames of the moving world, integrated in linear light over the exposure time.

Each slot of equal length has one rendered sub-frame. There are as few slots, up to
`subframes_max`, as keep the motion of a grid of pixels from one to the next within `step_px`: one
where nothing moves. Where surfaces as near as their bounding boxes allow would move by less, depth
is not needed to know that. With a rolling shutter the slots cover all rows, and each row has
weights of its own. Cameras that are exposed at different times have slots of their own.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.camera.frustum import nearest_depths_m
from sim.camera.render import GeometryBuffers, StereoRenderer
from sim.camera_settings import ExposureSettings
from sim.imaging.linear_light import decode
from sim.world.drawn import bodies_of
from sim.world.trip import Trip
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig

PROBE_PX = 16
"""Spacing of the pixels whose motion determines the number of sub-frames."""
PROBE_PERIOD_S = 0.002
PROBES_MAX = 16
INFINITE_M = 1e6
CERTAIN = 0.9
"""Fraction of a step within which the bound on a motion makes depth superfluous."""


@dataclass(frozen=True)
class Shutter:
    """Start and end of the exposure of each row, (2, H) for left and right, in absolute seconds."""

    start_s: Array
    end_s: Array


def open_shutter(settings: ExposureSettings, time_s: float, open_s: float, rows: int) -> Shutter:
    """Centre the middle row of the left camera, exposed for `open_s`, on a frame's timestamp."""
    lag_s = (np.arange(rows) - (rows - 1) / 2) * settings.line_time_us * 1e-6
    camera_s = np.array([0.0, settings.right_offset_ms * 1e-3])
    middle_s = time_s + camera_s[:, None] + lag_s
    return Shutter(middle_s - open_s / 2, middle_s + open_s / 2)


def expose(
    world: World,
    trip: Trip,
    renderer: StereoRenderer,
    settings: ExposureSettings,
    shutter: Shutter,
    geometry: Callable[[], GeometryBuffers],
) -> tuple[tuple[Array, Array], int]:
    """Integrate the light on both cameras over the exposure; moves the world.

    `geometry` gives that of the frame; it is called only if the motion is not certainly small.

    Returns:
        Left and right image, and the number of sub-frames. With one sub-frame they are as
            rendered, else float32 linear light, where 1 is the brightest grey level.
    """
    context = world, trip, renderer, settings, geometry
    if (shutter.start_s[0] == shutter.start_s[1]).all():
        return _integrate(*context, shutter)
    of_each = [Shutter(shutter.start_s[[i, i]], shutter.end_s[[i, i]]) for i in range(2)]
    (left, slots_left), (right, slots_right) = (_integrate(*context, x) for x in of_each)
    if slots_left != slots_right:  # one may be as rendered, the other integrated
        left, right = ([decode(x) if x.dtype == np.uint8 else x for x in y] for y in (left, right))
    return (left[0], right[1]), max(slots_left, slots_right)


def _integrate(
    world: World,
    trip: Trip,
    renderer: StereoRenderer,
    settings: ExposureSettings,
    geometry: Callable[[], GeometryBuffers],
    shutter: Shutter,
) -> tuple[tuple[Array, Array], int]:
    """Integrate over the time from the first row's exposure to the last one's."""
    start_s, end_s = float(shutter.start_s.min()), float(shutter.end_s.max())
    motion_px = 0.0
    if end_s > start_s:
        certain_px = CERTAIN * settings.step_px if np.ptp(shutter.start_s) == 0 else 0.0
        motion_px = _motion_px(world, trip, geometry, (start_s, end_s), certain_px)
    edges = slot_edges(shutter, motion_px / settings.step_px - 1e-6, settings.subframes_max)
    slots, middles_s = len(edges) - 1, (edges[1:] + edges[:-1]) / 2
    if slots == 1:
        _place(world, trip, (start_s + end_s) / 2)
        return renderer.render_images(), 1
    weights = slot_weights(shutter, edges)
    total = [np.zeros((), np.float32)] * 2
    for slot, time_s in enumerate(middles_s):
        _place(world, trip, float(time_s))
        for camera, image in enumerate(renderer.render_images()):
            by_row = weights[camera, :, slot].reshape(-1, *(1,) * (image.ndim - 1))
            light = decode(image) if image.dtype == np.uint8 else image
            total[camera] = total[camera] + light * by_row
    return (total[0], total[1]), slots


def _motion_px(
    world: World,
    trip: Trip,
    geometry: Callable[[], GeometryBuffers],
    open_s: tuple[float, float],
    certain_px: float,
) -> float:
    """Return the largest motion in the left image of the surfaces at mid-exposure, px.

    Points move with their body; the sky only rotates. It is 0 if it is certainly at most
    `certain_px`: the longest step of a ray is at its nearest or at its farthest point.
    """
    rig = world.render_rig
    rays, T = _probe_rays(rig), _motions(world, trip, open_s)
    px = rig.f_px * (len(T) - 1)
    _place(world, trip, sum(open_s) / 2)
    nearest_m = nearest_depths_m(world.model, world.data, rig)
    seen = np.flatnonzero(np.isfinite(nearest_m))
    ends_m = np.concatenate([nearest_m[seen], np.full(len(seen) + 1, INFINITE_M)])
    points = (ends_m[:, None, None] * rays).reshape(-1, 3)
    bodies = np.repeat([*seen, *seen, T.shape[1] - 1], len(rays))
    bound_px = px * _longest_step(points, bodies, T)
    if bound_px <= certain_px:
        return 0.0
    shown = geometry()
    depth_m = shown.depth_left_m[::PROBE_PX, ::PROBE_PX].ravel().astype(float)
    geoms = shown.geoms_left[::PROBE_PX, ::PROBE_PX].ravel()
    is_sky = np.isnan(depth_m)
    bodies = np.where(is_sky, T.shape[1] - 1, bodies_of(world.model)[geoms])
    points = np.where(is_sky, 1.0, depth_m)[:, None] * rays
    return px * _longest_step(points, bodies, T)


def _motions(world: World, trip: Trip, open_s: tuple[float, float]) -> Array:
    """Return the motions (M + 1, B + 1, 4, 4) of each body's points, in the left camera's axes.

    They lead from mid-exposure to M + 1 times from the start to the end; the last is of the sky.
    """
    start_s, end_s = open_s
    _place(world, trip, (start_s + end_s) / 2)
    T_cam_bodies = se3.inverse(world.T_world_cam) @ world.T_world_bodies
    T_bodies_cam, R_sky = se3.inverse(T_cam_bodies), world.T_world_cam[:3, :3]
    count = int(np.clip(math.ceil((end_s - start_s) / PROBE_PERIOD_S), 2, PROBES_MAX))
    T = np.tile(np.eye(4), (count + 1, len(T_bodies_cam) + 1, 1, 1))
    for k, time_s in enumerate(np.linspace(start_s, end_s, count + 1)):
        _place(world, trip, float(time_s))
        T_cam_world = se3.inverse(world.T_world_cam)
        T[k, :-1] = T_cam_world @ world.T_world_bodies @ T_bodies_cam
        T[k, -1, :3, :3] = T_cam_world[:3, :3] @ R_sky
    return T


def _probe_rays(rig: StereoRig) -> Array:
    """Return the rays (N, 3), of depth 1, of the pixels whose motion is probed."""
    v, u = (a.ravel() for a in np.mgrid[: rig.height_px : PROBE_PX, : rig.width_px : PROBE_PX])
    return np.column_stack([rig.normalized(np.column_stack([u, v])), np.ones(len(u))])


@compiled(nogil=True)
def _longest_step(points: Array, bodies: Indices, T: Array) -> float:
    """Return the longest step of points (N, 3) under motions (M, B, 4, 4), over the focal length.

    The bodies (N,) have the motion; what comes to lie behind the camera does not count.
    """
    longest = 0.0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        before_u, before_v = np.nan, np.nan
        for k in range(len(T)):
            M = T[k, bodies[i]]
            depth = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3]
            u = (M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3]) / depth
            v = (M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3]) / depth
            if depth <= 0:
                u = np.nan
            step = np.hypot(u - before_u, v - before_v)
            if step > longest:
                longest = step
            before_u, before_v = u, v
    return longest


def mean_brightness(world: World, shutter: Shutter, samples: int = 33) -> Array:
    """Return the mean illuminance of each row of the left camera, (H,); flicker gives bands."""
    share = np.linspace(0, 1, samples)
    start_s, end_s = shutter.start_s[0], shutter.end_s[0]
    if np.ptp(shutter.start_s) == 0:
        times_s = start_s[0] + share * (end_s[0] - start_s[0])
        return np.full(len(start_s), world.scene.brightness(times_s).mean())
    times_s = start_s[:, None] + share * (end_s - start_s)[:, None]
    return world.scene.brightness(times_s).mean(axis=1)


def slot_edges(shutter: Shutter, steps: float, slots_max: int) -> Array:
    """Return the edges of as many even slots, in seconds, as a motion of so many steps needs.

    Rows that are open for less than a slot blend two of them: there is one slot more, so that the
    middles of the first and the last slot are those of the first and the last row.
    """
    start_s, end_s = float(shutter.start_s.min()), float(shutter.end_s.max())
    slots = int(np.clip(math.ceil(steps), 1, slots_max))
    open_s = float(shutter.end_s[0, 0] - shutter.start_s[0, 0])
    is_rolling = shutter.start_s[0, -1] > shutter.start_s[0, 0]
    if is_rolling and steps > 0 and open_s < (end_s - start_s) / slots and slots < slots_max:
        outside_s = max(((end_s - start_s - open_s) / slots - open_s) / 2, 0.0)
        start_s, end_s, slots = start_s - outside_s, end_s + outside_s, slots + 1
    return np.linspace(start_s, end_s, slots + 1)


def slot_weights(shutter: Shutter, edges: Array) -> Array:
    """Return the weights (2, H, slots), with sums of one, for each row of left and right camera.

    Slots lie between even edges in seconds. A row without exposure time takes a slot's length.
    """
    slot_s = edges[1] - edges[0]
    middle = (shutter.start_s + shutter.end_s) / 2
    half = np.maximum(shutter.end_s - shutter.start_s, slot_s)[..., None] / 2
    low = np.maximum(middle[..., None] - half, edges[:-1])
    high = np.minimum(middle[..., None] + half, edges[1:])
    overlap = np.maximum(high - low, 0)
    return (overlap / overlap.sum(axis=-1, keepdims=True)).astype(np.float32)


def _place(world: World, trip: Trip, time_s: float) -> None:
    world.place(time_s, trip.states.at(world.model, time_s * 1e9))
