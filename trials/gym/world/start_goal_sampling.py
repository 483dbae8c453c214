"""Places to start from and to go to: drawn from what is free, or checked when they are given."""

import math
from dataclasses import dataclass

import numpy as np

from trials.gym.world.distance_field import Passages, Ways
from vo.contract.arrays import Array, Mask
from vo.contract.errors import DriftyardError

TRIES = 50
"""Starts that are tried before a world is said to have no pair of places."""
ASKEW_RAD = math.radians(30)
"""How far the rover may look away from its way at the start, to either side."""
ROOM_TO_START_M = 0.38
"""The rover reaches so far from its axle, backwards."""


class TrialError(DriftyardError):
    """A start, a goal or an action that the world or the rover cannot take."""


@dataclass(frozen=True)
class Errand:
    """Where to start, where to go, and the shortest way.

    Attributes:
        start: (3,) x, y in metres and yaw in radians, of the body frame in the world.
        ways: To the goal.
        waypoints: (N, 2) of the shortest way, N >= 2.
    """

    start: Array
    ways: Ways
    waypoints: Array

    @property
    def goal(self) -> Array:
        """(2,) world x, y in metres."""
        return self.ways.goal


def main_part(passages: Passages, inside: Array, world: str) -> Mask:
    """(H, W) cells with room that are connected to where people expect the rover to drive.

    Args:
        passages: Of the world.
        inside: (N, 2) world points of a route; the part that most of them lie in counts.
        world: Name, for the error.

    Raises:
        TrialError: If there is no free place.
    """
    cells = passages.free.cells(inside)
    rows, columns = cells[passages.free.inside(cells)].T
    parts = passages.parts[rows, columns]
    parts = parts[parts > 0] if (parts > 0).any() else passages.parts[passages.parts > 0]
    if len(parts) == 0:
        raise TrialError(
            f"scene {world}: no free place with {passages.clearance_m:g} m of room about the rover"
        )
    return passages.parts == np.bincount(parts).argmax()


def draw_errand(
    passages: Passages,
    part: Mask,
    distance_m: tuple[float, float],
    rng: np.random.Generator,
    start: Array | None = None,
    goal: Array | None = None,
) -> Errand:
    """Choose start and goal, each unless it is given.

    Args:
        passages: Of the world.
        part: (H, W) cells to choose from.
        distance_m: Least and largest length of the way; not asked of a goal that is given.
        rng: Chooses.
        start: (3,) x, y, yaw.
        goal: (2,) x, y.

    Raises:
        TrialError: If a given place is not free or cannot be reached, or there is no pair of
            places at such a distance.
    """
    least, largest = distance_m
    roomy = part & (passages.free.room_m >= max(ROOM_TO_START_M, passages.clearance_m))
    if start is not None:
        check_place(passages, "start", start[:2])
    if goal is not None:
        check_place(passages, "goal", goal)
        ways = passages.ways_to(goal)
        reached = np.isfinite(ways.lengths_m)
        if start is None:
            near = ways.lengths_m < max(least, float(np.min(ways.lengths_m[reached])))
            candidates = np.argwhere(roomy & reached & ~near & (ways.lengths_m <= largest))
            if len(candidates) == 0:
                raise TrialError(
                    f"goal ({goal[0]:g}, {goal[1]:g}) m: no start {least:g} to {largest:g} m away"
                )
            place = passages.free.points(candidates[rng.integers(len(candidates))])
        else:
            place = start[:2]
            if not reached[tuple(passages.free.cells(place))]:
                raise TrialError(
                    f"goal ({goal[0]:g}, {goal[1]:g}) m: no way from the start "
                    f"({place[0]:g}, {place[1]:g}) m with {passages.clearance_m:g} m of room"
                )
        return _errand(ways, place, rng, start)
    candidates = np.argwhere(roomy)
    for _ in range(TRIES if len(candidates) and start is None else 1 if start is not None else 0):
        place = start[:2] if start is not None else passages.free.points(
            candidates[rng.integers(len(candidates))]
        )  # fmt: skip
        lengths_m = passages.ways_to(place).lengths_m
        goals = np.argwhere(roomy & (lengths_m >= least) & (lengths_m <= largest))
        if len(goals):
            ways = passages.ways_to(passages.free.points(goals[rng.integers(len(goals))]))
            return _errand(ways, place, rng, start)
    raise TrialError(f"no two free places whose way is {least:g} to {largest:g} m long")


def check_place(passages: Passages, what: str, point: Array) -> None:
    """Refuse a world point (2,) where the rover has no room.

    Raises:
        TrialError: Names the obstacle.
    """
    free = passages.free
    cell = free.cells(point)
    said = f"{what} ({point[0]:g}, {point[1]:g}) m"
    if not free.inside(cell):
        raise TrialError(f"{said}: outside the world")
    if free.room_m[tuple(cell)] >= passages.clearance_m:
        return
    name, away_m = free.nearest(point)
    if away_m < free.cell_m:
        raise TrialError(f"{said}: inside {name}")
    raise TrialError(
        f"{said}: {free.room_m[tuple(cell)]:.2f} m of room beside {name}, the rover needs "
        f"{passages.clearance_m:g} m"
    )


def _errand(ways: Ways, place: Array, rng: np.random.Generator, start: Array | None) -> Errand:
    waypoints = ways.from_point(place)
    ahead = waypoints[1] - waypoints[0]
    yaw = math.atan2(ahead[1], ahead[0]) + rng.uniform(-ASKEW_RAD, ASKEW_RAD)
    return Errand(np.array([*place, yaw]) if start is None else start, ways, waypoints)
