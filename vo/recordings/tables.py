"""Text tables as tools and spreadsheets write them: rows of words, numbers and timestamps.

Columns are separated by semicolons, commas, tabs or blanks, which is decided in each row. Lines
that start with # or % are comments. Rows without a number before the first with one are a header.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.files import read_lines
from vo.contract.remarks import remark

NS, US, MS, SECONDS = 1, 1_000, 1_000_000, 1_000_000_000
UNITS = {SECONDS: "seconds", NS: "nanoseconds", MS: "milliseconds", US: "microseconds"}
"""Units of timestamps in ns, the usual ones first."""

MIN_STEP_NS = 100_000
"""Smallest time between rows, ns: sensors stay below 10 kHz."""

EPOCH_NS, MAX_STEP_NS = (631_152_000 * SECONDS, 4_102_444_800 * SECONDS), 2 * SECONDS
"""Times since 1970 are of the years 1990 to 2100, and their rows at most 2 s apart."""

MAX_STEPS = {SECONDS: 5, MS: 5_000, US: 1_000_000}
"""Largest number between rows of images, in each unit, if times do not count from 1970."""

MARGIN_NS = SECONDS
"""Time before and after a recording to which rows in seconds or nanoseconds may belong."""

MAX_RIVAL = 0.1
"""How much worse than the best another unit must fit a recording."""

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
"""A number that only an error can name: tables need decimal points."""

NUMBER_LIKE = re.compile(r"[-+.]?\d|[-+]?nan$|[-+]?inf", re.IGNORECASE)
"""Start of a word that stands in a row, not in a header: a number, or one in another notation."""

BRACKETS = re.compile(r"\[.*?\]|\((?!wxyz\)).*?\)")
"""Units after the name of a column, and what else is said of it but the order of quaternions."""


@dataclass(frozen=True)
class Table:
    """Rows of words of a file, and the line of each; errors are of the reader's class.

    Attributes:
        headers: Words of the comments and bare headers before the first row, without units in
            brackets; some of them may name the columns.
        separator: That of the first row; None for blanks.
    """

    path: Path
    headers: tuple[tuple[str, ...], ...]
    separator: str | None
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]
    error: type[DriftyardError]

    def __len__(self) -> int:
        return len(self.rows)

    def fault(self, row: int, message: str) -> DriftyardError:
        """Build the error of a row: file, line and message."""
        return self.error(f"{self.path}:{self.lines[row]}: {message}")

    def words(self, column: int, expected: str) -> list[str]:
        """Return one word of each row; raises the error of a row in which it is missing."""
        for i, row in enumerate(self.rows):
            if len(row) <= column or not row[column]:
                raise self.fault(i, f"{len(row)} columns; expected {expected}")
        return [row[column] for row in self.rows]

    def numbers(self, columns: Sequence[int], expected: str, finite: bool = True) -> Array:
        """Return numbers (N, C) of the given columns.

        Raises:
            DriftyardError: If a word is missing, no number or, on request, not finite; of class
                `error`, names file and line.
        """
        found = np.empty((len(self.rows), len(columns)))
        for k, column in enumerate(columns):
            for i, word in enumerate(self.words(column, expected)):
                if not _is_number(word):
                    raise self.fault(i, _no_number(word, expected))
                found[i, k] = number = float(word)
                if finite and not math.isfinite(number):
                    raise self.fault(i, f"{_short(word)} is not finite; expected {expected}")
        return found

    def stamps(self, column: int, expected: str) -> list[Decimal]:
        """Return the exact timestamps of a column, in the unit of the file.

        Raises:
            DriftyardError: If a word is missing or no number within int64; as `numbers`.
        """
        found: list[Decimal] = []
        for i, word in enumerate(self.words(column, expected)):
            if not _is_number(word):
                raise self.fault(i, _no_number(word, expected))
            found.append(Decimal(word))
            if not found[-1].is_finite() or found[-1].adjusted() > 18:
                message = f"the timestamp {_short(word)} is out of range; expected {expected}"
                raise self.fault(i, message)
        return found

    def times_ns(self, expected: str, unit_ns: int | None = None) -> Indices:
        """Return the timestamps (N,) of the first column in ns, exact to 1 ns.

        Without a unit, it is that which fits; `expected` names the columns of a row in errors.

        Raises:
            DriftyardError: If a timestamp is missing, no number, or out of range; as `numbers`.
        """
        stamps = self.stamps(0, expected)
        return self.in_ns(stamps, unit_ns or self.unit_ns(stamps, NS))

    def in_ns(self, stamps: Sequence[Decimal], unit_ns: int) -> Indices:
        """Convert the timestamps of the rows to ns (N,); raises the error of a row out of range."""
        times = [int((x * unit_ns).to_integral_value()) for x in stamps]
        for i, time in enumerate(times):
            if abs(time) >= 2**63:
                raise self.fault(i, f"the timestamp {stamps[i]} is out of range")
        return np.array(times, dtype=np.int64)

    def require_increasing(self, times_ns: Indices) -> None:
        """Raise the error of the first row whose time does not exceed that of the row before."""
        late = np.flatnonzero(np.diff(times_ns) <= 0)
        if len(late):
            i = int(late[0]) + 1
            kind = "repeats that" if times_ns[i] == times_ns[i - 1] else "is before that"
            message = f"time must increase, but {times_ns[i]} ns {kind} of line {self.lines[i - 1]}"
            raise self.fault(i, message)

    def unit_ns(
        self, stamps: Sequence[Decimal], default: int, frame_times_ns: Indices | None = None
    ) -> int:
        """Choose the unit in which timestamps fit a recording, or by their size and distance.

        Milliseconds and microseconds bring a remark. A single row without a recording is of the
        default unit, or in seconds if it has a fraction.

        Raises:
            DriftyardError: If several units fit; of class `error`, names file and line.
        """
        unit = None if frame_times_ns is None else self._fitting_unit(stamps, frame_times_ns)
        unit = unit or self._usual_unit(stamps, default)
        if unit in (MS, US):
            remark(f"{self.path}: timestamps are taken as {UNITS[unit]}")
        return unit

    def _fitting_unit(self, stamps: Sequence[Decimal], frame_times_ns: Indices) -> int | None:
        """Choose the unit in which the most rows lie within a recording, over the longest time."""
        values, step = np.array(stamps, dtype=float), median_step(stamps)
        fits: dict[int, float] = {}
        is_fractional = any(abs(x - round(x)) > Decimal("0.01") for x in stamps)
        for unit in (x for x in UNITS if x != NS or not is_fractional):
            times = values * unit - float(frame_times_ns[0])
            duration = float(frame_times_ns[-1] - frame_times_ns[0])
            margin = MARGIN_NS if unit in (SECONDS, NS) else 0
            inside = times[(times >= -margin) & (times <= duration + margin)]
            if len(inside) >= min(2, len(stamps)) and (step is None or step * unit >= MIN_STEP_NS):
                fits[unit] = len(inside) * float(np.ptp(inside))
        if not fits:
            return None
        best = max(fits, key=lambda unit: fits[unit])
        rivals = [x for x in fits if fits[x] > MAX_RIVAL * fits[best] and x != best]
        if rivals:
            raise self.fault(
                0, f"timestamps may be {UNITS[best]} or {UNITS[rivals[0]]}: both fit the recording"
            )
        return best

    def _usual_unit(self, stamps: Sequence[Decimal], default: int) -> int:
        step, is_fractional = median_step(stamps), any(x % 1 for x in stamps)
        if step is None:
            return SECONDS if is_fractional else default
        low, high = EPOCH_NS
        for unit in UNITS:
            is_usual = MIN_STEP_NS <= step * unit <= MAX_STEP_NS
            if is_usual and low <= stamps[0] * unit <= high:
                return unit
        unit = next((unit for unit, limit in MAX_STEPS.items() if step <= limit), NS)
        if unit == SECONDS and default == NS and not is_fractional:
            raise self.fault(
                0, f"timestamps are {step} apart: seconds, milliseconds or a count? Expected ns"
            )
        return unit


def median_step(stamps: Sequence[Decimal]) -> Decimal | None:
    """Return the median time between rows; None unless two of them differ."""
    steps = sorted(abs(b - a) for a, b in pairwise(stamps) if a != b)
    return steps[len(steps) // 2] if steps else None


def read_table(path: Path, error: type[DriftyardError] = DatasetError) -> Table:
    """Read the rows of a text table; none is an empty table.

    Raises:
        DriftyardError: If the file is missing or not text; of the class `error`.
    """
    comments: list[str] = []
    lines: list[int] = []
    rows: list[tuple[str, ...]] = []
    separator: str | None = None
    for number, line in enumerate(read_lines(path, error), start=1):
        text = line.strip()
        is_comment = text.startswith(("#", "%"))
        words = _split(text)
        if is_comment or not (rows or any(map(NUMBER_LIKE.match, words))):
            comments += [] if rows else [BRACKETS.sub("", text.lstrip("#% "))]
        elif words:
            separator = separator if rows else _separator(text)
            lines.append(number)
            rows.append(words)
    headers = tuple(filter(None, (_split(x, separator) for x in comments)))
    return Table(path, headers, separator, tuple(lines), tuple(rows), error)


def _separator(text: str) -> str | None:
    words = text.split()
    if len(words) > 1 and all(DECIMAL_COMMA.fullmatch(x) for x in words):
        return None
    return next((x for x in ";,\t" if x in text), None)


def _split(text: str, separator: str | None = None) -> tuple[str, ...]:
    """Split at a separator that the text has, by default its own."""
    at = separator if separator and separator in text else _separator(text)
    words = [word.strip().strip("\"'").strip() for word in text.split(at)]
    while words and not words[-1]:
        words.pop()
    return tuple(words)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word  # Python reads 1_000


def _no_number(word: str, expected: str) -> str:
    if _is_number(word.replace(",", ".")):
        return f"{_short(word)} has a decimal comma; expected {expected} with decimal points"
    return f"{_short(word)} is not a number; expected {expected}"


def _short(word: str) -> str:
    return word if len(word) <= 40 else f"{word[:39]}…"


def read_columns(path: Path) -> tuple[Indices, Array]:
    """Read a table of this project: (N,) timestamps in ns, (N, C) other columns of finite numbers.

    Raises:
        DatasetError: If the table is missing or malformed.
    """
    table = read_table(path)
    columns = len(table.rows[0]) if table.rows else 1
    expected = f"a timestamp in ns and {columns - 1} numbers"
    return table.times_ns(expected, NS), table.numbers(range(1, columns), expected)
