"""What moves in a trial and reacts to the rover.

Each thing has one coordinate, which it moves as it likes at the end of every stretch of physics,
and remembers, so that the pictures of a trial can be rendered again.
"""

from abc import ABC, abstractmethod
from array import array
from bisect import bisect_right

from vo.contract.arrays import Array


class Reacting(ABC):
    """A motion, as `Scene.movers` holds them, that depends on the rover."""

    def __init__(self, first: float) -> None:
        """Stand at the coordinate `first` until told otherwise."""
        self._first = first
        self.begin()

    def begin(self) -> None:
        """Put it to its beginning."""
        self._times_ns, self._places = array("q"), array("d")

    @property
    def place(self) -> float:
        """The coordinate now."""
        return self._places[-1] if self._places else self._first

    def react(self, time_s: float, rover: Array) -> None:
        """Move on to a time, later than the last one, with the rover's axle at (2,) x, y."""
        time_ns = round(time_s * 1e9)
        elapsed_s = (time_ns - self._times_ns[-1]) * 1e-9 if self._times_ns else 0.0
        place = self._moved(time_s, elapsed_s, rover)
        self._times_ns.append(time_ns)
        self._places.append(place)

    def __call__(self, time_s: float) -> Array:
        """(4, 4) T_world_mover at a time that is over."""
        time_ns = round(time_s * 1e9)
        after = bisect_right(self._times_ns, time_ns)
        if after == 0:
            return self._at(self._places[0] if self._places else self._first)
        if after == len(self._times_ns):
            return self._at(self._places[-1])
        since, until = self._times_ns[after - 1], self._times_ns[after]
        share = (time_ns - since) / (until - since)
        return self._at((1 - share) * self._places[after - 1] + share * self._places[after])

    @abstractmethod
    def _moved(self, time_s: float, elapsed_s: float, rover: Array) -> float:
        """The coordinate at a time."""

    @abstractmethod
    def _at(self, place: float) -> Array:
        """(4, 4) T_world_mover at a coordinate."""
