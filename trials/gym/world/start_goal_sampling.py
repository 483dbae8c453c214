"""Start and goal of a trial: sampled from the traversable space, or checked when given."""

import math
from dataclasses import dataclass

import numpy as np

from trials.gym.world.distance_field import DistanceField, TraversableSpace
from vo.contract.arrays import Array, Mask
from vo.contract.errors import DriftyardError

MAX_STARTS = 50
"""Starts that are tried before a world is reported to have no start and goal."""
MAX_HEADING_ERROR_RAD = math.radians(30)
"""Largest angle between the rover's heading and its path at the start, to either side."""
MIN_START_CLEARANCE_M = 0.38
"""Distance from the axle to the rearmost point of the rover."""


class TrialError(DriftyardError):
    """A start, a goal or an action that the world or the rover cannot take."""


@dataclass(frozen=True)
class StartGoal:
    """Start, goal and the shortest path.

    Attributes:
        start: (3,) x, y in metres and yaw in radians, of the body frame in the world.
        field: Shortest paths to the goal.
        path: (N, 2) waypoints of the shortest path, N >= 2.
    """

    start: Array
    field: DistanceField
    path: Array

    @property
    def goal(self) -> Array:
        """(2,) world x, y in metres."""
        return self.field.goal


def main_component(traversable: TraversableSpace, route: Array, scene: str) -> Mask:
    """(H, W) cells of the connected component that most of a scene's route (N, 2) lies in.

    Raises:
        TrialError: If there is no traversable place.
    """
    cells = traversable.space.cells(route)
    rows, columns = cells[traversable.space.inside(cells)].T
    found = traversable.components[rows, columns]
    found = found[found > 0] if (found > 0).any() else traversable.components[traversable.mask]
    if len(found) == 0:
        raise TrialError(
            f"scene {scene}: no place with {traversable.min_clearance_m:g} m of clearance "
            "around the rover"
        )
    return traversable.components == np.bincount(found).argmax()


def sample_start_goal(
    traversable: TraversableSpace,
    component: Mask,
    distance_m: tuple[float, float],
    rng: np.random.Generator,
    start: Array | None = None,
    goal: Array | None = None,
) -> StartGoal:
    """Sample start and goal, each unless it is given.

    Args:
        traversable: Space of the world.
        component: (H, W) cells to sample from.
        distance_m: Shortest and longest length of the path; ignored if both ends are given.
        rng: Source of the samples.
        start: (3,) x, y, yaw.
        goal: (2,) x, y.

    Raises:
        TrialError: If a given place has no clearance or cannot be reached, or there is no pair of
            places at such a distance.
    """
    if start is not None:
        expect_clear(traversable, "start", start[:2])
    clearance_m = max(MIN_START_CLEARANCE_M, traversable.min_clearance_m)
    roomy = component & (traversable.space.clearance_m >= clearance_m)
    if goal is None:
        return _sample_goal(traversable, roomy, distance_m, rng, start)
    expect_clear(traversable, "goal", goal)
    field = traversable.distance_field(goal)
    said = f"goal ({goal[0]:g}, {goal[1]:g}) m"
    if start is None:
        shortest, longest = distance_m
        far_enough = (field.distances_m >= shortest) & (field.distances_m <= longest)
        candidates = np.argwhere(roomy & far_enough)
        if len(candidates) == 0:
            raise TrialError(f"{said}: no start at a distance of {shortest:g} to {longest:g} m")
        place = traversable.space.points(candidates[rng.integers(len(candidates))])
        return _start_goal(field, place, rng, start)
    if np.isinf(field.distances_m[tuple(traversable.space.cells(start[:2]))]):
        raise TrialError(
            f"{said}: no path from the start ({start[0]:g}, {start[1]:g}) m with "
            f"{traversable.min_clearance_m:g} m of clearance"
        )
    return _start_goal(field, start[:2], rng, start)


def expect_clear(traversable: TraversableSpace, label: str, point: Array) -> None:
    """Refuse a world point (2,) where the rover has no clearance.

    Raises:
        TrialError: Names the obstacle.
    """
    space = traversable.space
    cell = space.cells(point)
    said = f"{label} ({point[0]:g}, {point[1]:g}) m"
    if not space.inside(cell):
        raise TrialError(f"{said}: outside the world")
    if space.clearance_m[tuple(cell)] >= traversable.min_clearance_m:
        return
    name, distance_m = space.nearest(point)
    if distance_m < space.cell_m:
        raise TrialError(f"{said}: inside {name}")
    raise TrialError(
        f"{said}: {space.clearance_m[tuple(cell)]:.2f} m of clearance beside {name}, the rover "
        f"needs {traversable.min_clearance_m:g} m"
    )


def _sample_goal(
    traversable: TraversableSpace,
    roomy: Mask,
    distance_m: tuple[float, float],
    rng: np.random.Generator,
    start: Array | None,
) -> StartGoal:
    """Sample a goal, and a start unless it is given, among the cells (H, W) of `roomy`."""
    space, (shortest, longest) = traversable.space, distance_m
    candidates = np.argwhere(roomy)
    for _ in range(1 if start is not None else MAX_STARTS if len(candidates) else 0):
        if start is None:
            place = space.points(candidates[rng.integers(len(candidates))])
        else:
            place = start[:2]
        distances_m = traversable.distance_field(place).distances_m
        goals = np.argwhere(roomy & (distances_m >= shortest) & (distances_m <= longest))
        if len(goals):
            field = traversable.distance_field(space.points(goals[rng.integers(len(goals))]))
            return _start_goal(field, place, rng, start)
    raise TrialError(f"no start and goal with a path of {shortest:g} to {longest:g} m between them")


def _start_goal(
    field: DistanceField, place: Array, rng: np.random.Generator, start: Array | None
) -> StartGoal:
    path = field.path_from(place)
    ahead = path[1] - path[0]
    error_rad = rng.uniform(-MAX_HEADING_ERROR_RAD, MAX_HEADING_ERROR_RAD)
    yaw = math.atan2(ahead[1], ahead[0]) + error_rad
    return StartGoal(np.array([*place, yaw]) if start is None else start, field, path)
