"""Crossings: where along a way a passage is narrow enough to be closed, and what that leaves."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from scenes.scene import Scene
from trials.gym.world.barriers import Slot
from trials.gym.world.distance_field import Passages, Ways, way_length_m
from trials.gym.world.free_space import NOTHING, FreeSpace
from vo.contract.arrays import Array, Mask

NARROWEST_M, WIDEST_M = 0.7, 3.2
"""Of the passages that are closed."""
GAP_M = 0.08
"""Between a barrier and what stands at either side."""
STATION_M = 0.2
FROM_START_M, FROM_GOAL_M = 1.6, 1.2
ANGLES = 12


def slots_along(scene: Scene, free: FreeSpace, way: Array, depth_m: float) -> list[Slot]:
    """Find where barriers of a depth fit across a way's passages.

    Args:
        scene: For the height of the ground.
        free: Obstacles.
        way: (N, 2) waypoints.
        depth_m: Along the passage.
    """
    points = stations(way, FROM_START_M, FROM_GOAL_M)
    slots = [slot_at(scene, free, point, depth_m) for point in points]
    return [slot for slot in slots if slot is not None]


def slot_at(scene: Scene, free: FreeSpace, point: Array, depth_m: float) -> Slot | None:
    """Where a barrier fits across the passage at a point (2,); None if it does not."""
    section = _narrowest(free, point)
    if section is None:
        return None
    centre, across_rad, width_m = section
    ground = np.array([*centre, float(scene.elevation(centre))])
    half = np.array([depth_m / 2, width_m / 2 - GAP_M])
    slot = Slot(ground, across_rad - math.pi / 2, half)
    fits = not (free.obstacles[_filled(free, [slot])] != NOTHING).any()
    return slot if fits else None


def stations(way: Array, from_start_m: float, from_goal_m: float) -> Array:
    """(N, 2) points of a way at equal distances, without those near its ends."""
    marks_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    asked_m = np.arange(from_start_m, marks_m[-1] - from_goal_m, STATION_M)
    return np.column_stack([np.interp(asked_m, marks_m, way[:, k]) for k in (0, 1)])


def with_closed(passages: Passages, slots: Sequence[Slot]) -> Passages:
    """What is left of passages when all slots are closed."""
    free = passages.free
    filled = _filled(free, slots)
    away = cv2.distanceTransform((~filled).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    room_m = np.minimum(free.room_m, np.maximum(away - 0.5, 0) * free.cell_m)
    return Passages(replace(free, room_m=room_m), passages.clearance_m)


def way_between(passages: Passages, start: Array, goal: Array) -> Array | None:
    """(N, 2) shortest way between two points (2,); None if there is none."""
    ways: Ways = passages.ways_to(goal)
    if not np.isfinite(ways.lengths_m[tuple(passages.free.cells(start))]):
        return None
    return ways.from_point(start)


def length_m(way: Array | None) -> float:
    """Of a way; infinite if there is none."""
    return math.inf if way is None else way_length_m(way)


def reach_m(free: FreeSpace, point: Array, along: Array, most_m: float, room_m: float) -> float:
    """How far one gets from a point (2,) in a direction (2,) with so much room all the way."""
    steps_m = np.arange(0.0, most_m + 1e-9, free.cell_m / 2)
    cells = free.cells(point + steps_m[:, None] * along)
    inside = free.inside(cells)
    rows, columns = np.clip(cells, 0, np.array(free.obstacles.shape) - 1).T
    bad = ~inside | (free.room_m[rows, columns] <= room_m)
    return float(steps_m[bad.argmax()] if bad.any() else most_m)


def _narrowest(free: FreeSpace, point: Array) -> tuple[Array, float, float] | None:
    """Middle (2,), direction and width of the shortest line across a passage; none if wide."""
    best: tuple[Array, float, float] | None = None
    for angle in np.linspace(0, math.pi, ANGLES, endpoint=False).tolist():
        across = np.array([math.cos(angle), math.sin(angle)])
        left_m = reach_m(free, point, across, WIDEST_M, 0.0)
        right_m = reach_m(free, point, -across, WIDEST_M, 0.0)
        width_m = left_m + right_m
        if NARROWEST_M <= width_m <= WIDEST_M and (best is None or width_m < best[2]):
            best = point + across * (left_m - right_m) / 2, angle, width_m
    return best


def _filled(free: FreeSpace, slots: Sequence[Slot]) -> Mask:
    """(H, W) cells that barriers stand on."""
    grid = np.zeros(free.obstacles.shape, np.uint8)
    for slot in slots:
        scaled = np.round((slot.corners - free.origin) / free.cell_m * 16).astype(np.int32)
        cv2.fillConvexPoly(grid, scaled, 1, cv2.LINE_8, 4)
    return grid.astype(bool)
