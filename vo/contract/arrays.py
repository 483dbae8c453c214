"""Array types by content, tables of columns, and the copy of values in compiled code."""

from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vo.contract.compilation import compiled

Array: TypeAlias = NDArray[Any]
"""Real numbers; the docstring gives shape, unit and frame."""

Image: TypeAlias = NDArray[np.uint8]
"""(H, W) grey, uint8, pixel centres on integers."""

Indices: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]


class Table:
    """Base of frozen dataclasses whose attributes are columns of N rows."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def select(self, rows: Mask | Indices) -> Self:
        """Keep some rows; if a mask keeps all, the table itself."""
        if rows.dtype == np.bool_:
            rows = rows.nonzero()[0]
            if len(rows) == len(self):
                return self
        return type(self)(**{name: x.take(rows, axis=0) for name, x in vars(self).items()})

    def extend(self, other: Self) -> Self:
        """Append the rows of another table."""
        if not len(self):
            return other
        theirs = vars(other)
        return type(self)(
            **{name: np.concatenate([own, theirs[name]]) for name, own in vars(self).items()}
        )


@compiled()
def find_sorted(values: Indices, wanted: Indices) -> Indices:
    """Find the row (N,) of each wanted value (N,) among others (M,); -1 where it is not.

    Both are ascending, each value once.
    """
    rows = np.full(len(wanted), -1, dtype=np.int64)
    row = 0
    for i in range(len(wanted)):
        while row < len(values) and values[row] < wanted[i]:
            row += 1
        if row < len(values) and values[row] == wanted[i]:
            rows[i] = row
    return rows


@compiled()
def choose_in_turn(groups: Indices, count: int) -> Mask:
    """Choose at most so many of N entries, from each group, a small number, one in every round.

    In a round, and of a group, earlier entries come first.
    """
    taken = np.zeros(groups.max() + 1 if len(groups) else 0, dtype=np.int64)
    rounds = np.empty_like(groups)
    sizes = np.zeros(len(groups) + 1, dtype=np.int64)
    for i in range(len(groups)):
        rounds[i] = taken[groups[i]]
        taken[groups[i]] += 1
        sizes[rounds[i]] += 1
    whole, left = 0, count
    while whole < len(groups) and sizes[whole] <= left:
        left -= sizes[whole]
        whole += 1
    chosen = rounds < whole
    for i in range(len(groups)):
        if rounds[i] == whole and left > 0:
            chosen[i] = True
            left -= 1
    return chosen


@compiled()
def copy_values(values: Array, out: Array) -> None:
    """Write the values of an array into another of its shape.

    `out[:] = values` takes seconds to compile: Numba adds the text of an error about shapes.
    """
    for index, value in np.ndenumerate(values):
        out[index] = value
