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
        """Keep some rows."""
        return type(self)(**{name: column[rows] for name, column in vars(self).items()})

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
def ranks_in_groups(group: Indices) -> Indices:
    """Count, for each of N entries, those before it that have the same group, a small number."""
    taken = np.zeros(group.max() + 1 if len(group) else 0, dtype=np.int64)
    ranks = np.empty_like(group)
    for i in range(len(group)):
        ranks[i] = taken[group[i]]
        taken[group[i]] += 1
    return ranks


@compiled()
def copy_values(values: Array, out: Array) -> None:
    """Write the values of an array into another of its shape.

    `out[:] = values` takes seconds to compile: Numba adds the text of an error about shapes.
    """
    for index, value in np.ndenumerate(values):
        out[index] = value
