"""Wheel encoder readings and their table."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo.contract.arrays import Indices
from vo.contract.errors import DatasetError
from vo.contract.tables import read_rows

STALE_NS = 250_000_000
"""Age from which a reading is ignored: silent encoders would look like wheels at rest."""


@dataclass(frozen=True)
class WheelLog:
    """Readings of the left and the right wheel encoder.

    Attributes:
        timestamps_ns: (N,) int64, strictly increasing.
        ticks: (N, 2) int64, left and right, counted since the start, forward positive.
    """

    timestamps_ns: Indices
    ticks: Indices

    def at(self, timestamp_ns: int) -> tuple[int, int] | None:
        """Return the last reading at or before a time; None if there is none or it is stale."""
        i = int(np.searchsorted(self.timestamps_ns, timestamp_ns, side="right")) - 1
        if i < 0 or timestamp_ns - int(self.timestamps_ns[i]) > STALE_NS:
            return None
        left, right = self.ticks[i]
        return int(left), int(right)


def read_wheels(table: Path) -> WheelLog | None:
    """Read rows of 'timestamp [ns],left [ticks],right [ticks]'; None where there is no such file.

    Raises:
        DatasetError: If a row is malformed or time does not increase; names file and line.
    """
    if not table.is_file():
        return None
    rows: list[tuple[int, int, int]] = []
    for place, words in read_rows(table):
        try:
            time_ns, left, right = (int(word) for word in words)
        except ValueError:
            expected = "'timestamp [ns],left [ticks],right [ticks]', whole numbers"
            raise DatasetError(f"{place}: expected {expected}") from None
        if rows and time_ns <= rows[-1][0]:
            raise DatasetError(f"{place}: time must increase")
        rows.append((time_ns, left, right))
    values = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return WheelLog(values[:, 0], values[:, 1:])
