"""Text tables: numbered rows of words, and columns of numbers after a timestamp."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, DriftyardError


def read_lines(path: Path, error: type[DriftyardError] = DatasetError) -> list[str]:
    """Read the lines of a UTF-8 file.

    Raises:
        error: If the file is missing, unreadable or not text; names the file.
    """
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file") from None


def read_rows(
    path: Path, separator: str | None = ",", error: type[DriftyardError] = DatasetError
) -> Iterator[tuple[str, list[str]]]:
    """Yield place (`file:line`) and words of each row; skip blank lines and comments (`#`).

    A separator of None is white space.
    """
    for number, line in enumerate(read_lines(path, error), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"{path}:{number}", [word.strip() for word in line.split(separator)]


def read_columns(
    path: Path, columns: Sequence[int] | None = None, error: type[DriftyardError] = DatasetError
) -> tuple[Indices, Array]:
    """Read comma-separated numbers: (N,) int64 timestamps in ns, (N, C) other or given columns."""
    try:  # timestamps have too many digits for a float
        times = np.loadtxt(path, delimiter=",", usecols=0, dtype=np.int64, ndmin=1)
        values = np.loadtxt(path, delimiter=",", usecols=columns, ndmin=2)
    except (OSError, ValueError, IndexError) as problem:
        raise error(f"{path}: missing or malformed ({problem})") from None
    return times, values if columns else values[:, 1:]
