"""Tasks: what is to be reached, and the reward for it; judged on the true position."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.world.path import Path
from trials.gym.world.distance_field import Passages, Ways, way_length_m
from trials.gym.world.start_goal_sampling import Errand
from vo.contract.arrays import Array, Mask

SUCCESS, FAILURE = 10.0, -10.0
STEP = -0.01
"""Reward of an episode that ends well or badly, and of every step; progress counts a metre as 1."""
PROGRESS_STEP_M = 0.02
RAYS = 180


@dataclass(frozen=True)
class Verdict:
    """What the last step was worth.

    Attributes:
        reward: For it.
        success: Whether the task is done.
        failure: Why it cannot be done any more; empty if it can.
        left_m: Way that is left.
        share: Of the task that is done, 0 to 1.
    """

    reward: float
    success: bool
    failure: str
    left_m: float
    share: float


class Task(Protocol):
    """What the rover is asked to do.

    Attributes:
        start: (3,) x, y, yaw where it begins.
        way: (N, 2) waypoints of the shortest way, or the route; N may be 1.
        way_m: Its length.
    """

    start: Array
    way: Array
    way_m: float

    def goal(self, believed: Array) -> Array:
        """Where to go, (2,) world x, y, for a rover that believes to be at (2,)."""
        ...

    def judge(self, true: Array) -> Verdict:
        """Weigh the step that brought the rover to (2,)."""
        ...


class ReachGoal:
    """Come within a radius of a goal by any way."""

    def __init__(self, errand: Errand, radius_m: float) -> None:
        self.start, self.way = errand.start, errand.waypoints
        self._ways: Ways = errand.ways
        self._radius_m = radius_m
        self.way_m = way_length_m(errand.waypoints)
        self._left_m = self._ways.length_m(errand.start[:2])

    def goal(self, believed: Array) -> Array:
        """The goal itself."""
        return self._ways.goal

    def judge(self, true: Array) -> Verdict:
        """Reward coming closer, along the shortest way."""
        left_m = self._ways.length_m(true)
        progress_m, self._left_m = self._left_m - left_m, left_m
        done = bool(np.linalg.norm(true - self._ways.goal) <= self._radius_m)
        share = 1.0 if done else max(0.0, 1 - left_m / self.way_m)
        return Verdict(STEP + progress_m + SUCCESS * done, done, "", left_m, share)


class FollowRoute:
    """Drive along a route to its end without leaving it."""

    def __init__(self, path: Path, stray_m: float, radius_m: float, lookahead_m: float) -> None:
        ahead = path.waypoints[1] - path.waypoints[0]
        self.start = np.array([*path.waypoints[0], math.atan2(ahead[1], ahead[0])])
        self.way, self.way_m = path.waypoints, path.length_m
        self._path, self._stray_m, self._radius_m = path, stray_m, radius_m
        self._lookahead_m = lookahead_m
        self._true_m = self._believed_m = 0.0

    def goal(self, believed: Array) -> Array:
        """The point of the route that is one lookahead further than the rover believes to be."""
        self._believed_m, _ = self._along(believed, self._believed_m)
        return self._path.at(self._believed_m + self._lookahead_m)

    def judge(self, true: Array) -> Verdict:
        """Reward progress along the route; being beside it costs as much as the way back."""
        along_m, beside_m = self._along(true, self._true_m)
        progress_m, self._true_m = along_m - self._true_m, along_m
        left_m = self._path.length_m - along_m
        done = left_m <= self._radius_m and beside_m <= self._radius_m
        failure = "strayed" if beside_m > self._stray_m and not done else ""
        reward = STEP * (1 + beside_m / self._stray_m) + progress_m + SUCCESS * done
        return Verdict(reward, done, failure, left_m, along_m / self._path.length_m)

    def _along(self, position: Array, from_m: float) -> tuple[float, float]:
        """Nearest point of the route not far ahead, by arc length, and the distance to it."""
        reach = np.arange(0.0, self._stray_m + PROGRESS_STEP_M, PROGRESS_STEP_M)
        marks = np.minimum(from_m + reach, self._path.length_m)
        away = np.linalg.norm(self._path.at(marks) - position, axis=1)
        k = int(np.argmin(away))
        return float(marks[k]), float(away[k])


class Explore:
    """Bring a share of the open ground into view, then return to the start.

    Attributes:
        covered: (H, W) cells that were in view.
    """

    def __init__(
        self,
        passages: Passages,
        part: Mask,
        start: Array,
        share: float,
        view_m: float,
        radius_m: float,
    ) -> None:
        self.start, self.way, self.way_m = start, start[None, :2], 0.0
        self.covered = np.zeros(part.shape, bool)
        self._part, self._free = part, passages.free
        self._blocked = self._free.room_m <= 0
        self._home = passages.ways_to(start[:2])
        self._wanted, self._view_m, self._radius_m = share, view_m, radius_m
        turn = np.linspace(0, 2 * math.pi, RAYS, endpoint=False)
        reach = np.arange(0.0, view_m, self._free.cell_m / 2)
        self._rays = np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, None] * reach[:, None]
        self._cells = int(part.sum())
        self._home_m = 0.0
        self._look(start[:2])

    def goal(self, believed: Array) -> Array:
        """The start, where to return to."""
        return self.start[:2]

    def judge(self, true: Array) -> Verdict:
        """Reward new ground by the square metre, and afterwards the way home."""
        before = self._share
        self._look(true)
        home_m, last_m = self._home.length_m(true), self._home_m
        self._home_m = home_m
        enough = self._share >= self._wanted
        reward = STEP + (self._share - before) * self._cells * self._free.cell_m**2
        if enough and before >= self._wanted:
            reward += last_m - home_m
        done = enough and bool(np.linalg.norm(true - self.start[:2]) <= self._radius_m)
        share = min(1.0, self._share / self._wanted)
        return Verdict(reward + SUCCESS * done, done, "", home_m, share)

    @property
    def _share(self) -> float:
        return float((self.covered & self._part).sum()) / self._cells

    def _look(self, position: Array) -> None:
        """Mark what rays from a position (2,) meet before an obstacle."""
        cells = self._free.cells(position + self._rays)
        outside = ~self._free.inside(cells)
        cells = np.clip(cells, 0, np.array(self.covered.shape) - 1)
        rows, columns = cells[..., 0], cells[..., 1]
        hidden = np.logical_or.accumulate(self._blocked[rows, columns] | outside, axis=1)
        self.covered[rows[~hidden], columns[~hidden]] = True
