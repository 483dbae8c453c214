"""The index of frames: one row a frame, from what manifests and the indexes of tar files say."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from trials.execution.location import Location, location_of
from trials.report.columns import Schema, columns_file
from trials.shards.catalogue import MEMBERS, Entry, members_of

ROWS = 100_000
"""Rows that are written at once, about."""
SCHEMA: Schema = {
    **dict.fromkeys(("location", "dataset", "scene"), str),
    "seed": int,
    **dict.fromkeys(("complete", "certified"), bool),
    **dict.fromkeys(("frame", "timestamp_ns"), int),
    **dict.fromkeys(("labels", "shard"), str),
    **{f"{x}_{what}": int for x in MEMBERS for what in ("offset", "size")},
}
"""Columns: labels are separated by commas; `shard` is the tar file, null in a folder; offset and
size of each of MEMBERS in it are null if the frame lacks it. In a folder, where each has a file of
its own, the offset is 0 and the size null."""


def write_frames(
    entries: Sequence[Entry], out: str, progress: Callable[[object], None] = lambda _: None
) -> int:
    """Write a row for each frame of datasets to a Parquet or CSV file; return their number.

    Args:
        entries: Datasets.
        out: File, here or in a location.
        progress: Called with each dataset.

    Raises:
        SettingsError: If the suffix is another, or pyarrow is not installed.
        StoreError: If the file cannot be written.
    """
    if location_of(out) is not None:
        folder, _, name = out.rpartition("/")
        with TemporaryDirectory() as here:
            file = Path(here) / name
            count = write_frames(entries, str(file), progress)
            Location(folder).send(file, name)
        return count
    count = 0
    with columns_file(Path(out), SCHEMA) as append:
        for columns in _groups(entries, progress):
            append(columns)
            count += len(columns["frame"])
    return count


def _groups(
    entries: Sequence[Entry], progress: Callable[[object], None]
) -> Iterator[dict[str, list[Any]]]:
    """Yield columns of about ROWS rows."""
    columns: dict[str, list[Any]] = {x: [] for x in SCHEMA}
    for entry in entries:
        for name, values in _rows(entry).items():
            columns[name] += values
        progress(entry)
        if len(columns["frame"]) >= ROWS:
            yield columns
            columns = {x: [] for x in SCHEMA}
    if columns["frame"]:
        yield columns


def _rows(entry: Entry) -> dict[str, list[Any]]:
    """Return the columns of a dataset."""
    files = entry.files
    members = members_of(files)
    times = sorted(members["left"])
    about = {
        "location": str(entry.location),
        "dataset": entry.name,
        "scene": entry.scenes[0],
        "seed": entry.seed,
        "complete": entry.is_complete,
        "certified": entry.is_certified,
        "labels": ",".join(entry.labels),
    }
    columns: dict[str, list[Any]] = {key: [x] * len(times) for key, x in about.items()}
    columns |= {"frame": list(range(len(times))), "timestamp_ns": times}
    left = [files[members["left"][t]] for t in times]
    columns["shard"] = [None if size is None else name for name, _, size in left]
    for name in MEMBERS:
        paths = members.get(name, {})
        places = [files[paths[t]] if t in paths else (None, None, None) for t in times]
        columns |= {
            f"{name}_offset": [x[1] for x in places],
            f"{name}_size": [x[2] for x in places],
        }
    return columns
