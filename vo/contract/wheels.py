"""What wheel encoders counted, and the table that holds it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo.contract.arrays import Indices
from vo.contract.errors import DatasetError

STALE_NS = 250_000_000
"""A reading this old says nothing of a frame: silent encoders look like wheels at rest."""


@dataclass(frozen=True)
class WheelLog:
    """Readings of the left and the right wheel's encoder.

    Attributes:
        timestamps_ns: (N,) int64, strictly increasing.
        ticks: (N, 2) int64, left and right, counted since the start, forward positive.
    """

    timestamps_ns: Indices
    ticks: Indices

    def at(self, timestamp_ns: int) -> tuple[int, int] | None:
        """The last reading at or before a time; None if there is none or it is stale."""
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
    try:
        lines = table.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"{table}: cannot be read ({error})") from None
    rows: list[tuple[int, int, int]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            time_ns, left, right = (int(word) for word in line.split(","))
        except ValueError:
            expected = "'timestamp [ns],left [ticks],right [ticks]', whole numbers"
            raise DatasetError(f"{table}:{number}: expected {expected}") from None
        if rows and time_ns <= rows[-1][0]:
            raise DatasetError(f"{table}:{number}: time must increase")
        rows.append((time_ns, left, right))
    values = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return WheelLog(values[:, 0], values[:, 1:])
