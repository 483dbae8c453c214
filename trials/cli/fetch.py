"""`driftyard fetch`: datasets of a location, or some of their labels, as folders."""

from pathlib import Path

from trials.cli import console
from trials.cli.locations import SelectionOptions
from trials.cli.options import option
from trials.shards.fetching import fetch_all


def fetch(
    selection: SelectionOptions,
    out: Path = option(..., "Folder that gets a folder for each dataset.", metavar="FOLDER"),
) -> None:
    """Download datasets, all or by scene, seed and label; only the bytes that they need are read.

    Every file is compared with its hash. Datasets that are there already are not read again.
    """
    entries = selection.entries
    size, there = 0, 0
    with console.counting_bar("fetching", len(entries)) as progress:
        for count in fetch_all(entries, selection.selection.labels, out):
            size, there = size + count, there + (count == 0)
            progress(count)
    if there:
        console.out.print(f"{there} of {len(entries)} datasets are there already")
    console.out.print(f"{out}: {len(entries)} datasets, {size / 2**20:.1f} MiB read", markup=False)
