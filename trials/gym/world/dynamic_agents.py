"""Base of the things that move in a trial and react to the rover.

An agent has one coordinate, which it changes at the end of every stretch of physics. It records
the coordinate over time, so that the images of a trial can be rendered again.
"""

from abc import ABC, abstractmethod
from array import array
from bisect import bisect_right

from vo.contract.arrays import Array


class DynamicAgent(ABC):
    """A motion, as in `Scene.movers`, that depends on the rover."""

    def __init__(self, initial: float) -> None:
        """Stay at the coordinate `initial` until the first call of `advance`."""
        self._initial = initial
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._times_ns, self._coordinates = array("q"), array("d")

    @property
    def coordinate(self) -> float:
        """The present coordinate."""
        return self._coordinates[-1] if self._coordinates else self._initial

    def advance(self, time_s: float, rover: Array) -> None:
        """Move on to a later time, with the rover's axle at (2,) x, y."""
        time_ns = round(time_s * 1e9)
        elapsed_s = (time_ns - self._times_ns[-1]) * 1e-9 if self._times_ns else 0.0
        coordinate = self._next(time_s, elapsed_s, rover)
        self._times_ns.append(time_ns)
        self._coordinates.append(coordinate)

    def __call__(self, time_s: float) -> Array:
        """(4, 4) T_world_mover at a past time."""
        time_ns = round(time_s * 1e9)
        after = bisect_right(self._times_ns, time_ns)
        if after == 0:
            return self._pose(self._coordinates[0] if self._coordinates else self._initial)
        if after == len(self._times_ns):
            return self._pose(self._coordinates[-1])
        since, until = self._times_ns[after - 1], self._times_ns[after]
        w = (time_ns - since) / (until - since)
        return self._pose((1 - w) * self._coordinates[after - 1] + w * self._coordinates[after])

    @abstractmethod
    def _next(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        """The coordinate at a time, `elapsed_s` after the last one."""

    @abstractmethod
    def _pose(self, coordinate: float) -> Array:
        """(4, 4) T_world_mover at a coordinate."""
