"""Slots for barriers: where along a path a passage is narrow enough to be closed."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from scenes.scene import Scene
from trials.gym.world.dynamic_agents import Slot
from trials.gym.world.free_space import NO_GEOM, FreeSpace, TraversableSpace
from vo.contract.arrays import Array, Mask

MIN_WIDTH_M, MAX_WIDTH_M = 0.7, 3.2
"""Width of the passages that can be closed."""
GAP_M = 0.08
"""Gap between a barrier and the obstacle on either side."""
SPACING_M = 0.2
"""Distance between the points of a path at which slots are looked for."""
FROM_START_M, FROM_GOAL_M = 1.6, 1.2
"""Length of both ends of a path that are left without barriers."""
ANGLES = 12


def slots_along(scene: Scene, space: FreeSpace, path: Array, depth_m: float) -> list[Slot]:
    """Find slots for barriers of a depth across the passages of a path (N, 2)."""
    points = sample_path(path, FROM_START_M, FROM_GOAL_M)
    slots = [slot_at(scene, space, point, depth_m) for point in points]
    return [slot for slot in slots if slot is not None]


def slot_at(scene: Scene, space: FreeSpace, point: Array, depth_m: float) -> Slot | None:
    """Find the slot across the passage at a point (2,); None if no barrier fits there."""
    section = _narrowest_section(space, point)
    if section is None:
        return None
    centre, across_rad, width_m = section
    ground = np.array([*centre, float(scene.elevation(centre))])
    half = np.array([depth_m / 2, width_m / 2 - GAP_M])
    slot = Slot(ground, across_rad - math.pi / 2, half)
    fits = not (space.obstacles[_covered(space, [slot])] != NO_GEOM).any()
    return slot if fits else None


def sample_path(path: Array, from_start_m: float, from_goal_m: float) -> Array:
    """(N, 2) points of a path (M, 2) at equal distances, without those near its ends."""
    stations_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    wanted_m = np.arange(from_start_m, stations_m[-1] - from_goal_m, SPACING_M)
    return np.column_stack([np.interp(wanted_m, stations_m, path[:, k]) for k in (0, 1)])


def with_slots_closed(traversable: TraversableSpace, slots: Sequence[Slot]) -> TraversableSpace:
    """Return what remains of the traversable space when all slots are closed."""
    space = traversable.space
    open_cells = (~_covered(space, slots)).astype(np.uint8)
    distance = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clearance_m = np.minimum(space.clearance_m, np.maximum(distance - 0.5, 0) * space.cell_m)
    return TraversableSpace(replace(space, clearance_m=clearance_m), traversable.min_clearance_m)


def free_distance_m(
    space: FreeSpace, point: Array, direction: Array, max_m: float, clearance_m: float
) -> float:
    """Distance from a point (2,) in a direction (2,) up to which there is more clearance."""
    steps_m = np.arange(0.0, max_m + 1e-9, space.cell_m / 2)
    cells = space.cells(point + steps_m[:, None] * direction)
    inside = space.inside(cells)
    rows, columns = np.clip(cells, 0, np.array(space.obstacles.shape) - 1).T
    blocked = ~inside | (space.clearance_m[rows, columns] <= clearance_m)
    return float(steps_m[blocked.argmax()] if blocked.any() else max_m)


def _narrowest_section(space: FreeSpace, point: Array) -> tuple[Array, float, float] | None:
    """Middle (2,), direction and width of the shortest line across a passage; None if wide."""
    best: tuple[Array, float, float] | None = None
    for angle in np.linspace(0, math.pi, ANGLES, endpoint=False).tolist():
        across = np.array([math.cos(angle), math.sin(angle)])
        left_m = free_distance_m(space, point, across, MAX_WIDTH_M, 0.0)
        right_m = free_distance_m(space, point, -across, MAX_WIDTH_M, 0.0)
        width_m = left_m + right_m
        if MIN_WIDTH_M <= width_m <= MAX_WIDTH_M and (best is None or width_m < best[2]):
            best = point + across * (left_m - right_m) / 2, angle, width_m
    return best


def _covered(space: FreeSpace, slots: Sequence[Slot]) -> Mask:
    """(H, W) cells that the slots cover."""
    grid = np.zeros(space.obstacles.shape, np.uint8)
    for slot in slots:
        scaled = np.round((slot.corners - space.origin) / space.cell_m * 16).astype(np.int32)
        cv2.fillConvexPoly(grid, scaled, 1, cv2.LINE_8, 4)
    return grid.astype(bool)
