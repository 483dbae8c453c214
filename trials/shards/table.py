"""The index of frames: one row a frame, as Parquet, from what manifests and tar indexes say."""

import io
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from trials.execution.location import Location
from trials.shards.catalogue import MEMBERS, Entry
from vo.contract.errors import DriftyardError

ROWS = 100_000
"""Rows of a group in the file, about."""


def write_parquet(
    entries: Sequence[Entry], url: str, progress: Callable[[object], None] = lambda _: None
) -> int:
    """Write a row for each frame of datasets to a file at a location; return their number.

    Columns: `location`, `dataset`, `scene`, `seed`, `complete`, `certified`, `frame` (index),
    `timestamp_ns`, `labels`, `shard` (tar file, null in a folder), and for each of MEMBERS
    `NAME_offset` and `NAME_size` in the shard, null if the frame lacks it; in a folder, which has
    a file of its own for it, the offset is 0 and the size null.

    Raises:
        DriftyardError: If pyarrow is not installed.
        StoreError: If the file cannot be written.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise DriftyardError("pyarrow is not installed: pip install 'driftyard[parquet]'") from None
    word, number = pa.dictionary(pa.int32(), pa.string()), pa.int64()
    kinds = {
        **dict.fromkeys(("location", "dataset", "scene"), word),
        "seed": number,
        **dict.fromkeys(("complete", "certified"), pa.bool_()),
        **dict.fromkeys(("frame", "timestamp_ns"), number),
        "labels": pa.list_(pa.string()),
        "shard": word,
        **{f"{x}_{what}": number for x in MEMBERS for what in ("offset", "size")},
    }
    schema, file, count = pa.schema(kinds), io.BytesIO(), 0
    with pq.ParquetWriter(file, schema) as writer:
        for columns in _groups(entries, tuple(kinds), progress):
            writer.write_table(pa.table(columns, schema))
            count += len(columns["frame"])
    folder, _, name = url.rpartition("/")
    Location(folder or ".").write_whole(name, file.getvalue())
    return count


def _groups(
    entries: Sequence[Entry], names: Sequence[str], progress: Callable[[object], None]
) -> Iterator[dict[str, list[Any]]]:
    """Yield columns of about ROWS rows."""
    columns: dict[str, list[Any]] = {x: [] for x in names}
    for entry in entries:
        for name, values in _rows(entry).items():
            columns[name] += values
        progress(entry)
        if len(columns["frame"]) >= ROWS:
            yield columns
            columns = {x: [] for x in names}
    if columns["frame"]:
        yield columns


def _rows(entry: Entry) -> dict[str, list[Any]]:
    """Return the columns of a dataset."""
    members = entry.members
    times = sorted(members["left"])
    about = {
        "location": entry.location.url,
        "dataset": entry.name,
        "scene": entry.scenes[0],
        "seed": entry.seed,
        "complete": entry.is_complete,
        "certified": entry.is_certified,
        "labels": list(entry.labels),
    }
    columns: dict[str, list[Any]] = {key: [x] * len(times) for key, x in about.items()}
    columns |= {"frame": list(range(len(times))), "timestamp_ns": times}
    left = [entry.files[members["left"][t]] for t in times]
    columns["shard"] = [None if size is None else name for name, _, size in left]
    for name in MEMBERS:
        paths = members.get(name, {})
        places = [entry.files[paths[t]] if t in paths else (None, None, None) for t in times]
        columns |= {
            f"{name}_offset": [x[1] for x in places],
            f"{name}_size": [x[2] for x in places],
        }
    return columns
