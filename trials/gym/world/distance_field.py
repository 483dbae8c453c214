"""Ways through free space: shortest ones from one place to everywhere.

Source: Dijkstra, A note on two problems in connexion with graphs, 1959, on the 8-connected grid
(SciPy's); ways are then pulled tight, as any-angle planners do after the fact.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy import sparse
from scipy.ndimage import distance_transform_edt
from scipy.sparse.csgraph import dijkstra

from trials.gym.world.free_space import FreeSpace
from vo.contract.arrays import Array, Indices, Mask

SQRT2 = float(np.sqrt(2))
STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, SQRT2), (1, -1, SQRT2))
"""Down, right and length of half of the eight steps."""


@dataclass(frozen=True)
class Passages:
    """Where the rover's axle may be, and what is connected to what.

    Attributes:
        free: The free space.
        clearance_m: Room that the axle must have everywhere.
    """

    free: FreeSpace
    clearance_m: float

    @cached_property
    def open(self) -> Mask:
        """(H, W) cells with enough room."""
        return self.free.room_m >= self.clearance_m

    @cached_property
    def parts(self) -> Indices:
        """(H, W) number of the connected part that a cell belongs to; 0 has no room."""
        _, parts = cv2.connectedComponents(self.open.astype(np.uint8), connectivity=4)
        return np.asarray(parts, np.int64)

    @cached_property
    def _graph(self) -> sparse.csr_matrix:
        shape = self.open.shape
        number = np.arange(self.open.size).reshape(shape)
        edges: list[tuple[Array, Array, Array]] = []
        for down, right, length in STEPS:
            low = slice(max(0, -right), shape[1] - max(0, right))
            high = slice(max(0, right), shape[1] - max(0, -right))
            rows, below = slice(0, shape[0] - down), slice(down, shape[0])
            both = self.open[rows, low] & self.open[below, high]
            if down and right:
                both &= self.open[rows, high] & self.open[below, low]
            a, b = number[rows, low][both], number[below, high][both]
            edges.append((a, b, np.full(len(a), length * self.free.cell_m)))
        first, second, lengths = (np.concatenate(x) for x in zip(*edges, strict=True))
        size = self.open.size
        return sparse.csr_matrix((lengths, (first, second)), shape=(size, size))

    def ways_to(self, point: Array) -> "Ways":
        """Find the shortest ways from everywhere to an open world point (2,)."""
        goal = int(np.ravel_multi_index(tuple(self.free.cells(point)), self.open.shape))
        lengths, before = dijkstra(
            self._graph, directed=False, indices=goal, return_predecessors=True
        )
        return Ways(self, point, lengths.reshape(self.open.shape), before)

    def sees(self, a: Array, b: Array) -> bool:
        """Whether the straight way between world points (2,) is open."""
        steps = max(2, int(np.linalg.norm(b - a) / (0.5 * self.free.cell_m)) + 1)
        share = np.linspace(0, 1, steps)[:, None]
        rows, columns = self.free.cells(a + share * (b - a)).T
        return bool(self.open[rows, columns].all())


@dataclass(frozen=True)
class Ways:
    """Shortest ways to one place.

    Attributes:
        passages: Through what.
        goal: (2,) world x, y.
        lengths_m: (H, W) from each cell along the grid; infinite where there is no way.
        towards: (H * W,) the next cell on the way, negative at the goal and where there is none.
    """

    passages: Passages
    goal: Array
    lengths_m: Array
    towards: Indices

    def length_m(self, point: Array) -> float:
        """Length of the way from a world point (2,), at least the straight one.

        From a cell without room it is that of the nearest one with room.
        """
        free = self.passages.free
        row, column = np.clip(free.cells(point), 0, np.array(self.lengths_m.shape) - 1)
        straight = float(np.linalg.norm(self.goal - point))
        length = float(self.lengths_m[row, column])
        if not np.isfinite(length):
            row, column = self._nearest_known[:, row, column]
            detour = float(np.linalg.norm(free.points(np.array([row, column])) - point))
            length = float(self.lengths_m[row, column]) + detour
        return max(length, straight)

    @cached_property
    def _nearest_known(self) -> Indices:
        """(2, H, W) nearest cell that has a way."""
        unknown = ~np.isfinite(self.lengths_m)
        indices = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        return np.asarray(indices, np.int64)

    def from_point(self, point: Array) -> Array:
        """(N, 2) waypoints of the way from an open world point (2,), pulled tight; N >= 2."""
        shape = self.lengths_m.shape
        node = int(np.ravel_multi_index(tuple(self.passages.free.cells(point)), shape))
        nodes = [node]
        while self.towards[nodes[-1]] >= 0:
            nodes.append(int(self.towards[nodes[-1]]))
        cells = np.column_stack(np.unravel_index(nodes, shape))
        way = np.vstack([point, self.passages.free.points(cells[1:-1]), self.goal])
        tight = [way[0]]
        k = 0
        while k < len(way) - 1:
            ahead = len(way) - 1
            while ahead > k + 1 and not self.passages.sees(way[k], way[ahead]):
                ahead = k + max(1, (ahead - k) // 2)
            while ahead + 1 < len(way) and self.passages.sees(way[k], way[ahead + 1]):
                ahead += 1
            tight.append(way[ahead])
            k = ahead
        return np.array(tight)


def way_length_m(waypoints: Array) -> float:
    """Length of a polyline (N, 2)."""
    return float(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum())
