"""Start and goal of a trial: sampled from the traversable space, or checked when given."""

import math
from dataclasses import dataclass

import numpy as np

from trials.gym.world.free_space import NO_GEOM, NO_GROUND, DistanceField, TraversableSpace
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.errors import DriftyardError

MAX_STARTS = 50
"""Starts that are tried before a world is reported to have no start and goal."""
MAX_HEADING_ERROR_RAD = math.radians(30)
"""Largest angle between the rover's heading and its path at the start, to either side."""
MIN_START_CLEARANCE_M = 0.38
"""Distance from the axle to the rearmost point of the rover."""

NO_GROUND_SAID = "there is no ground that the rover can drive on"


class TrialError(DriftyardError):
    """A start, a goal or an action that the world or the rover cannot take."""


@dataclass(frozen=True)
class StartGoal:
    """Start (3,), x, y in metres and yaw in radians, and the path (N >= 2, 2) to the goal."""

    start: Array
    field: DistanceField
    path: Array


def main_component(traversable: TraversableSpace, route: Array, scene: str) -> Mask:
    """(H, W) cells of the connected component that most of a scene's route (N, 2) lies in.

    Raises a TrialError if there is no traversable place.
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
    """Sample start (3,), x, y, yaw, and goal (2,) in a component (H, W), each unless it is given.

    `distance_m` is the shortest and longest length of the path, ignored if both ends are given.

    Raises:
        TrialError: If a given place has no clearance or cannot be reached, or there is no pair of
            places at such a distance.
    """
    if start is not None:
        expect_start(traversable, start[:2])
    space, (shortest, longest) = traversable.space, distance_m
    clearance_m = max(MIN_START_CLEARANCE_M, traversable.min_clearance_m)
    roomy = component & (space.clearance_m >= clearance_m) & space.is_drawn

    def far_enough(distances_m: Array, where: Mask = roomy) -> Indices:
        return np.argwhere(where & (distances_m >= shortest) & (distances_m <= longest))

    def sampled(cells: Indices) -> Array:
        return space.points(cells[rng.integers(len(cells))])

    if goal is None:
        places = np.argwhere(roomy & space.is_level)
        for _ in range(1 if start is not None else MAX_STARTS if len(places) else 0):
            place = sampled(places) if start is None else start[:2]
            goals = far_enough(traversable.distances_m(place, longest))
            if len(goals):
                return _start_goal(traversable.distance_field(sampled(goals)), place, rng, start)
        between = f"{shortest:g} to {longest:g} m between them"
        raise TrialError(f"no start and goal with a path of {between}")
    expect_clear(traversable, "goal", goal)
    field = traversable.distance_field(goal)
    said = f"goal ({goal[0]:g}, {goal[1]:g}) m"
    if start is None:
        starts = far_enough(field.distances_m, roomy & space.is_level)
        if len(starts) == 0:
            raise TrialError(f"{said}: no start at a distance of {shortest:g} to {longest:g} m")
        return _start_goal(field, sampled(starts), rng, start)
    if np.isinf(field.distances_m[tuple(space.cells(start[:2]))]):
        raise TrialError(
            f"{said}: no path from the start ({start[0]:g}, {start[1]:g}) m with "
            f"{traversable.min_clearance_m:g} m of clearance"
        )
    return _start_goal(field, start[:2], rng, start)


def expect_clear(traversable: TraversableSpace, label: str, point: Array) -> None:
    """Refuse a world point (2,) without clearance; raises a TrialError that names the obstacle."""
    space = traversable.space
    cell = space.cells(point)
    said = f"{label} ({point[0]:g}, {point[1]:g}) m"
    if not space.inside(cell):
        raise TrialError(f"{said}: outside the world")
    if space.clearance_m[tuple(cell)] >= traversable.min_clearance_m:
        return
    if space.obstacles[tuple(cell)] == NO_GROUND:
        raise TrialError(f"{said}: {NO_GROUND_SAID}")
    name, distance_m = space.nearest(point)
    if distance_m < space.cell_m:
        raise TrialError(f"{said}: inside {name}")
    raise TrialError(
        f"{said}: {space.clearance_m[tuple(cell)]:.2f} m of clearance beside {name}, the rover "
        f"needs {traversable.min_clearance_m:g} m"
    )


def expect_start(traversable: TraversableSpace, point: Array) -> None:
    """Refuse a start (2,) without clearance, or on ground of another height than is stated."""
    expect_clear(traversable, "start", point)
    space = traversable.space
    if not space.is_level[tuple(space.cells(point))]:
        raise TrialError(
            f"start ({point[0]:g}, {point[1]:g}) m: the ground is not as high as the scene states"
        )


def expect_route(traversable: TraversableSpace, points: Array) -> None:
    """Refuse a route (N, 2) that leaves the ground or ends in an obstacle."""
    space = traversable.space
    cells = np.clip(space.cells(points), 0, np.array(space.obstacles.shape) - 1)
    found = space.obstacles[tuple(cells.T)]
    for point in points[found == NO_GROUND]:
        raise TrialError(f"route near ({point[0]:.2f}, {point[1]:.2f}) m: {NO_GROUND_SAID}")
    if found[-1] != NO_GEOM:
        end = points[-1]
        raise TrialError(
            f"route: its end ({end[0]:g}, {end[1]:g}) m is inside {space.names[found[-1]]}"
        )


def _start_goal(
    field: DistanceField, place: Array, rng: np.random.Generator, start: Array | None
) -> StartGoal:
    path = field.path_from(place)
    ahead = path[1] - path[0]
    error_rad = rng.uniform(-MAX_HEADING_ERROR_RAD, MAX_HEADING_ERROR_RAD)
    yaw = math.atan2(ahead[1], ahead[0]) + error_rad
    return StartGoal(np.array([*place, yaw]) if start is None else start, field, path)
