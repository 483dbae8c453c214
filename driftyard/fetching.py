"""Datasets of locations such as buckets, fetched into folders."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.dataset import open as open_dataset
from driftyard.failures import in_one_family
from trials.shards.fetching import fetch_all
from trials.shards.selection import Selection, select


@in_one_family
def fetch(
    locations: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    scenes: Iterable[str] = (),
    seeds: Iterable[int] = (),
    labels: Iterable[str] | None = None,
) -> list[Dataset]:
    """Fetch datasets from where `driftyard generate --out` wrote them; only what is chosen is read.

    Every file is compared with its hash. Datasets that are there already are not read again.
    A dataset of which labels are left out is as if it had been recorded without them.

    Args:
        locations: One or several: folders, or locations of fsspec such as `s3://bucket/many`,
            with dataset folders or tar files and their index.
        out: Folder that gets a folder for each dataset.
        scenes: Names of scenes; all by default.
        seeds: Random seeds; all by default.
        labels: Labels that are needed; all by default, none with an empty one.

    Returns:
        The datasets, open, in the order of their names.

    Raises:
        SettingsError: If there is no such label.
        DatasetError: If no dataset is chosen, or a folder exists with other content.
        DriftyardError: If a location cannot be read, or holds a damaged file.

    Example:
        >>> [x.labels for x in dy.fetch("ds", "fetched", labels=["depth"])]
        [('depth',)]
    """
    many = (
        [*locations]
        if isinstance(locations, Sequence) and not isinstance(locations, str)
        else [locations]
    )
    chosen = Selection(
        tuple(scenes),
        tuple(range(x, x + 1) for x in seeds),
        None if labels is None else tuple(labels),
    )
    entries = select([os.fspath(x) for x in many], chosen)
    for _ in fetch_all(entries, chosen.labels, Path(out)):
        pass
    return [open_dataset(Path(out) / x.name) for x in entries]
