"""Tasks of the environments and their rewards, evaluated at the true position."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sim.world.path import Path
from trials.gym.env.settings import ExploreSettings, RouteSettings
from trials.gym.world.free_space import TraversableSpace, path_length_m
from trials.gym.world.start_goal_sampling import StartGoal
from vo.contract.arrays import Array, Mask

SUCCESS, FAILURE = 10.0, -10.0
"""Reward of an episode that ends with success or with failure."""
STEP = -0.01
"""Reward of every step; a metre of progress counts 1."""
PROGRESS_STEP_M = 0.02
"""Resolution of the position along a route."""
RAYS = 180


@dataclass(frozen=True)
class Evaluation:
    """Reward of a step, whether the task is done, why it has failed, and what remains of the path.

    `progress` is the fraction of the task that is done, 0 to 1.
    """

    reward: float
    success: bool
    failure: str
    remaining_m: float
    progress: float


class Task(ABC):
    """What the rover has to do.

    Attributes:
        start: (3,) x, y, yaw at the beginning.
        path: (N, 2) waypoints of the shortest path, or the route; N may be 1.
        path_m: Length of the path.
        covered: (H, W) cells that were in view; None if the task does not ask for it.
    """

    start: Array
    path: Array
    path_m: float
    covered: Mask | None = None

    @abstractmethod
    def goal(self, estimated: Array) -> Array:
        """(2,) world x, y to drive to, for a rover whose estimated position is (2,)."""

    @abstractmethod
    def evaluate(self, true: Array) -> Evaluation:
        """Evaluate the step that brought the rover to (2,)."""


class ReachGoal(Task):
    """Come within a radius of a goal by any path."""

    def __init__(self, ends: StartGoal, radius_m: float) -> None:
        self.start, self.path = ends.start, ends.path
        self._field, self._radius_m = ends.field, radius_m
        self.path_m = path_length_m(ends.path)
        self._remaining_m = self._field.distance_m(ends.start[:2])

    def goal(self, estimated: Array) -> Array:
        """The goal itself."""
        return self._field.goal

    def evaluate(self, true: Array) -> Evaluation:
        """Reward progress along the shortest path."""
        remaining_m = self._field.distance_m(true)
        gain_m, self._remaining_m = self._remaining_m - remaining_m, remaining_m
        done = bool(np.linalg.norm(true - self._field.goal) <= self._radius_m)
        progress = 1.0 if done else max(0.0, 1 - remaining_m / self.path_m)
        return Evaluation(STEP + gain_m + SUCCESS * done, done, "", remaining_m, progress)


class FollowRoute(Task):
    """Drive along a route to its end without leaving it."""

    def __init__(self, path: Path, trial: RouteSettings) -> None:
        ahead = path.waypoints[1] - path.waypoints[0]
        self.start = np.array([*path.waypoints[0], math.atan2(ahead[1], ahead[0])])
        self.path, self.path_m = path.waypoints, path.length_m
        self._route, self._trial = path, trial
        self._true_m = self._estimated_m = 0.0

    def goal(self, estimated: Array) -> Array:
        """The point of the route that is one lookahead beyond the estimated position."""
        self._estimated_m, _ = self._project(estimated, self._estimated_m)
        return self._route.at(self._estimated_m + self._trial.lookahead_m)

    def evaluate(self, true: Array) -> Evaluation:
        """Reward progress along the route, less a cost that grows with the distance from it."""
        along_m, beside_m = self._project(true, self._true_m)
        gain_m, self._true_m = along_m - self._true_m, along_m
        remaining_m = self._route.length_m - along_m
        done = max(remaining_m, beside_m) <= self._trial.goal_radius_m
        stray_m = self._trial.stray_m
        failure = "strayed" if beside_m > stray_m and not done else ""
        reward = STEP * (1 + beside_m / stray_m) + gain_m + SUCCESS * done
        return Evaluation(reward, done, failure, remaining_m, along_m / self._route.length_m)

    def _project(self, position: Array, from_m: float) -> tuple[float, float]:
        """Nearest point of the route shortly ahead, by arc length, and the distance to it."""
        reach = np.arange(0.0, self._trial.stray_m + PROGRESS_STEP_M, PROGRESS_STEP_M)
        stations_m = np.minimum(from_m + reach, self._route.length_m)
        distances_m = np.linalg.norm(self._route.at(stations_m) - position, axis=1)
        k = int(np.argmin(distances_m))
        return float(stations_m[k]), float(distances_m[k])


class Explore(Task):
    """Bring a fraction of the reachable ground into view, then return to the start."""

    def __init__(self, traversable: TraversableSpace, start: Array, trial: ExploreSettings) -> None:
        self.start, self.path, self.path_m = start, start[None, :2], 0.0
        self._space, components = traversable.space, traversable.components
        self._reachable = components == components[tuple(self._space.cells(start[:2]))]
        self.covered = self._covered = np.zeros(components.shape, bool)
        self._blocked = self._space.clearance_m <= 0
        self._home = traversable.distance_field(start[:2])
        self._wanted, self._radius_m = trial.cover_share, trial.goal_radius_m
        angles = np.linspace(0, 2 * math.pi, RAYS, endpoint=False)
        reach = np.arange(0.0, trial.view_m, self._space.cell_m / 2)
        self._rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None] * reach[:, None]
        self._cells = int(self._reachable.sum())
        self._home_m = 0.0
        self._add_view(start[:2])

    def goal(self, estimated: Array) -> Array:
        """The start, where the rover has to return to."""
        return self.start[:2]

    def evaluate(self, true: Array) -> Evaluation:
        """Reward new ground by the square metre, and afterwards the way back."""
        before = self._fraction
        self._add_view(true)
        home_m, last_m = self._home.distance_m(true), self._home_m
        self._home_m = home_m
        enough = self._fraction >= self._wanted
        reward = STEP + (self._fraction - before) * self._cells * self._space.cell_m**2
        if enough and before >= self._wanted:
            reward += last_m - home_m
        done = enough and bool(np.linalg.norm(true - self.start[:2]) <= self._radius_m)
        progress = min(1.0, self._fraction / self._wanted)
        return Evaluation(reward + SUCCESS * done, done, "", home_m, progress)

    @property
    def _fraction(self) -> float:
        return float((self._covered & self._reachable).sum()) / self._cells

    def _add_view(self, position: Array) -> None:
        """Mark what rays from a position (2,) meet before an obstacle."""
        cells = self._space.cells(position + self._rays)
        outside = ~self._space.inside(cells)
        cells = np.clip(cells, 0, np.array(self._covered.shape) - 1)
        rows, columns = cells[..., 0], cells[..., 1]
        hidden = np.logical_or.accumulate(self._blocked[rows, columns] | outside, axis=1)
        self._covered[rows[~hidden], columns[~hidden]] = True
