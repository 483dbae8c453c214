"""Tables of many rows as files of columns, Parquet or CSV, for pandas, DuckDB and others.

Rows are written part by part, so that a table of a million rows does not stand in memory.
"""

import csv
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix, replacing

Schema = Mapping[str, type[str] | type[int] | type[float] | type[bool]]
"""Name of each column and the type of its values."""
Columns = Mapping[str, Any]
"""Name of each column to its values, an array or list, or one value for all rows."""
PARQUET, SUFFIXES = ".parquet", (".parquet", ".csv")


def check_columns(path: Path) -> None:
    """Raise SettingsError if the name has another suffix, or a package for it is missing."""
    if known_suffix(path, SUFFIXES) == PARQUET:
        _arrow("pyarrow")


def _arrow(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise SettingsError(
            'Parquet files need pyarrow: pip install "driftyard[parquet]", or name a .csv file'
        ) from None


@contextmanager
def columns_file(path: Path, schema: Schema) -> Generator[Callable[[Columns], None]]:
    """Yield a function that appends rows; the table replaces `path` when the block succeeds.

    NaN and None are null in Parquet, and empty in CSV.

    Raises:
        SettingsError: As `check_columns`.
    """
    check_columns(path)
    with ExitStack() as stack:
        partial = stack.enter_context(replacing(path))
        if known_suffix(path, SUFFIXES) == PARQUET:
            arrow, parquet = _arrow("pyarrow"), _arrow("pyarrow.parquet")
            types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
            types[bool] = arrow.bool_()
            fields = arrow.schema([(name, types[kind]) for name, kind in schema.items()])
            file = stack.enter_context(parquet.ParquetWriter(partial, fields))

            def append(columns: Columns) -> None:
                arrays = [
                    arrow.array(x, field.type, from_pandas=True)
                    for x, field in zip(_filled(columns, schema), fields, strict=True)
                ]
                file.write_table(arrow.Table.from_arrays(arrays, schema=fields))
        else:
            stream = stack.enter_context(partial.open("w", encoding="utf-8", newline=""))
            rows = csv.writer(stream, lineterminator="\n")
            rows.writerow(schema)

            def append(columns: Columns) -> None:
                values = [x.tolist() if isinstance(x, np.ndarray) else x
                          for x in _filled(columns, schema)]  # fmt: skip
                rows.writerows(
                    ["" if x is None or x != x else x for x in row]
                    for row in zip(*values, strict=True)
                )

        yield append


def _filled(columns: Columns, schema: Schema) -> list[Any]:
    """Return the values of each column of the schema, all of one length."""
    values = [columns[name] for name in schema]
    length = next((len(x) for x in values if not np.isscalar(x) and x is not None), 1)
    return [[x] * length if np.isscalar(x) or x is None else x for x in values]
