"""Traversable space, and the distance field of the shortest paths through it to one goal.

Source: Dijkstra, A note on two problems in connexion with graphs, 1959, on the 8-connected grid
(SciPy's); paths are then shortened by line-of-sight checks.
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
class TraversableSpace:
    """Where the rover's axle may be, and which places are connected.

    Attributes:
        space: The free space.
        min_clearance_m: Distance from obstacles that the axle must keep.
    """

    space: FreeSpace
    min_clearance_m: float

    @cached_property
    def mask(self) -> Mask:
        """(H, W) cells with enough clearance."""
        return self.space.clearance_m >= self.min_clearance_m

    @cached_property
    def components(self) -> Indices:
        """(H, W) number of the connected component of each cell; 0 without clearance."""
        _, components = cv2.connectedComponents(self.mask.astype(np.uint8), connectivity=4)
        return np.asarray(components, np.int64)

    @cached_property
    def _graph(self) -> sparse.csr_matrix:
        shape = self.mask.shape
        number = np.arange(self.mask.size).reshape(shape)
        edges: list[tuple[Array, Array, Array]] = []
        for down, right, length in STEPS:
            low = slice(max(0, -right), shape[1] - max(0, right))
            high = slice(max(0, right), shape[1] - max(0, -right))
            rows, below = slice(0, shape[0] - down), slice(down, shape[0])
            both = self.mask[rows, low] & self.mask[below, high]
            if down and right:
                both &= self.mask[rows, high] & self.mask[below, low]
            a, b = number[rows, low][both], number[below, high][both]
            edges.append((a, b, np.full(len(a), length * self.space.cell_m)))
        first, second, lengths = (np.concatenate(x) for x in zip(*edges, strict=True))
        size = self.mask.size
        return sparse.csr_matrix((lengths, (first, second)), shape=(size, size))

    def distance_field(self, goal: Array) -> "DistanceField":
        """Find the shortest paths from everywhere to a traversable world point (2,)."""
        index = int(np.ravel_multi_index(tuple(self.space.cells(goal)), self.mask.shape))
        distances, before = dijkstra(
            self._graph, directed=False, indices=index, return_predecessors=True
        )
        return DistanceField(self, goal, distances.reshape(self.mask.shape), before)

    def shortest_path(self, start: Array, goal: Array) -> Array | None:
        """(N, 2) shortest path between two traversable points (2,); None if there is none."""
        field = self.distance_field(goal)
        if not np.isfinite(field.distances_m[tuple(self.space.cells(start))]):
            return None
        return field.path_from(start)

    def has_line(self, a: Array, b: Array) -> bool:
        """Whether the straight line between world points (2,) is traversable."""
        steps = max(2, int(np.linalg.norm(b - a) / (0.5 * self.space.cell_m)) + 1)
        fraction = np.linspace(0, 1, steps)[:, None]
        rows, columns = self.space.cells(a + fraction * (b - a)).T
        return bool(self.mask[rows, columns].all())


@dataclass(frozen=True)
class DistanceField:
    """Shortest paths to one goal.

    Attributes:
        traversable: Space that the paths lead through.
        goal: (2,) world x, y.
        distances_m: (H, W) from each cell along the grid; infinite where there is no path.
        next_cells: (H * W,) next cell on the path, negative at the goal and where there is none.
    """

    traversable: TraversableSpace
    goal: Array
    distances_m: Array
    next_cells: Indices

    def distance_m(self, point: Array) -> float:
        """Length of the path from a world point (2,), at least the straight distance.

        From a cell without path it is that of the nearest cell with one, plus the detour.
        """
        space = self.traversable.space
        row, column = np.clip(space.cells(point), 0, np.array(self.distances_m.shape) - 1)
        straight = float(np.linalg.norm(self.goal - point))
        length = float(self.distances_m[row, column])
        if not np.isfinite(length):
            row, column = self._nearest_known[:, row, column]
            detour = float(np.linalg.norm(space.points(np.array([row, column])) - point))
            length = float(self.distances_m[row, column]) + detour
        return max(length, straight)

    @cached_property
    def _nearest_known(self) -> Indices:
        """(2, H, W) nearest cell that has a path."""
        unknown = ~np.isfinite(self.distances_m)
        indices = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        return np.asarray(indices, np.int64)

    def path_from(self, point: Array) -> Array:
        """(N, 2) waypoints from a traversable world point (2,), shortened; N >= 2."""
        shape = self.distances_m.shape
        node = int(np.ravel_multi_index(tuple(self.traversable.space.cells(point)), shape))
        nodes = [node]
        while self.next_cells[nodes[-1]] >= 0:
            nodes.append(int(self.next_cells[nodes[-1]]))
        cells = np.column_stack(np.unravel_index(nodes, shape))
        path = np.vstack([point, self.traversable.space.points(cells[1:-1]), self.goal])
        has_line = self.traversable.has_line
        shortened = [path[0]]
        k = 0
        while k < len(path) - 1:
            ahead = len(path) - 1
            while ahead > k + 1 and not has_line(path[k], path[ahead]):
                ahead = k + max(1, (ahead - k) // 2)
            while ahead + 1 < len(path) and has_line(path[k], path[ahead + 1]):
                ahead += 1
            shortened.append(path[ahead])
            k = ahead
        return np.array(shortened)


def path_length_m(path: Array) -> float:
    """Length of a polyline (N, 2)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
