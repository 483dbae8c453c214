"""Shortest paths on the 8-connected grid of traversable cells to one of them.

Sources: Dijkstra, A note on two problems in connexion with graphs, 1959; cells in buckets by their
distance in place of a queue: Dial, Algorithm 360, 1969. A bucket is narrower than a step, so that
no cell of it brings another one of it nearer, and their order does not matter.
"""

import numpy as np

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.compilation import compiled

SQRT2 = float(np.sqrt(2))
BUCKET_CELLS = 0.999
"""Width of a bucket, a little below a step for the sake of rounding."""
BUCKETS = 4
"""More than the longest step in buckets, used in turn."""
NONE = -1


@compiled()
def _length(mask: Mask, row: int, column: int, down: int, right: int, cell_m: float) -> float:
    """Return the length of a step to one of eight neighbours; infinite where it is blocked.

    A diagonal step needs both cells beside it.
    """
    to_row, to_column = row + down, column + right
    if not (0 <= to_row < mask.shape[0] and 0 <= to_column < mask.shape[1]):
        return np.inf
    if not mask[to_row, to_column] or (down == 0 and right == 0):
        return np.inf
    if down == 0 or right == 0:
        return cell_m
    return SQRT2 * cell_m if mask[row, to_column] and mask[to_row, column] else np.inf


@compiled()
def grid_distances(mask: Mask, row: int, column: int, cell_m: float, limit_m: float) -> Array:
    """Return the length (H, W) of the shortest path from each cell to one; infinite beyond a limit.

    Args:
        mask: (H, W) traversable cells.
        row: Row of the cell, which is traversable.
        column: Its column.
        cell_m: Side of a cell.
        limit_m: Longest length that is looked for.
    """
    width = mask.shape[1]
    distances = np.full(mask.shape, np.inf)
    heads = np.full(BUCKETS, NONE, np.int64)
    entries = 8 * mask.size + 1  # each cell enters its neighbours at most once
    following, cells = np.empty(entries, np.int64), np.empty(entries, np.int64)
    lengths = np.empty(entries)
    distances[row, column], lengths[0] = 0.0, 0.0
    cells[0], following[0], heads[0] = row * width + column, NONE, 0
    used, open_entries, bucket = 1, 1, 0
    while open_entries:
        entry, heads[bucket % BUCKETS] = heads[bucket % BUCKETS], NONE
        while entry != NONE:
            length, cell = lengths[entry], cells[entry]
            entry, open_entries = following[entry], open_entries - 1
            r, c = cell // width, cell % width
            if length > distances[r, c]:  # a shorter path was found after it had entered
                continue
            for down in range(-1, 2):
                for right in range(-1, 2):
                    longer = length + _length(mask, r, c, down, right, cell_m)
                    if longer <= limit_m and longer < distances[r + down, c + right]:
                        distances[r + down, c + right] = longer
                        wanted = int(longer / (BUCKET_CELLS * cell_m)) % BUCKETS
                        cells[used] = (r + down) * width + c + right
                        lengths[used], following[used] = longer, heads[wanted]
                        heads[wanted], used, open_entries = used, used + 1, open_entries + 1
        bucket += 1
    return distances


@compiled()
def grid_path(mask: Mask, distances: Array, row: int, column: int, cell_m: float) -> Indices:
    """Return the cells (N, 2) of the shortest path from a cell; N = 1 where there is none.

    Of equally short ones it takes the nearest next cell, and of equally near ones the first.
    """
    path = np.empty((mask.size, 2), np.int64)
    count, r, c = 0, row, column
    while r != NONE:
        path[count, 0], path[count, 1] = r, c
        count += 1
        here, nearest = distances[r, c], np.inf
        next_row, next_column = NONE, NONE
        for down in range(-1, 2):
            for right in range(-1, 2):
                step = _length(mask, r, c, down, right, cell_m)
                if np.isfinite(step):
                    there = distances[r + down, c + right]
                    if there + step == here and there < nearest:
                        nearest, next_row, next_column = there, r + down, c + right
        r, c = next_row, next_column
    return path[:count]


@compiled()
def is_clear_line(
    mask: Mask, origin: Array, cell_m: float, a: Array, b: Array, points: int
) -> bool:
    """Return whether evenly spaced points of a line from `a` to `b` (2,), x, y, are traversable.

    The centre of cell (0, 0) is at the origin (2,); rows count along y.
    """
    for k in range(points):
        share = k * (1.0 / (points - 1)) if k < points - 1 else 1.0
        column = int(np.floor((a[0] + share * (b[0] - a[0]) - origin[0]) / cell_m + 0.5))
        row = int(np.floor((a[1] + share * (b[1] - a[1]) - origin[1]) / cell_m + 0.5))
        if not mask[row, column]:
            return False
    return True
