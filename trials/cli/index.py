"""`driftyard index`: which datasets locations hold, one row a frame, and their checksums."""

from collections import defaultdict
from pathlib import Path

import typer

from trials.cli import console
from trials.cli.locations import SelectionOptions
from trials.cli.options import option
from trials.report.columns import check_columns
from trials.shards.catalogue import Entry
from trials.shards.checking import find_damage
from trials.shards.table import write_frames


def index(
    selection: SelectionOptions,
    out: str = option(
        "", "Table to write, a row a frame: .parquet (extra `parquet`) or .csv.", metavar="FILE"
    ),
    verify: bool = option(False, "Read all files and compare them with their checksums."),
) -> None:
    """List the datasets of locations by scene; no image is read.

    What an interruption left half-written is not listed. The exit status is 1 if --verify finds a
    difference.
    """
    if out:
        check_columns(Path(out))
    entries = selection.entries
    console.print_table(("scene", "datasets", "seeds", "frames", "labels"), _rows(entries))
    shards = {(x.location, name): y.size for x in entries for name, y in x.shards.items()}
    if shards:
        size = sum(shards.values()) / 2**30
        console.out.print(f"{len(shards)} tar files of {size:.3g} GiB")
    if out:
        with console.counting_bar("writing", len(entries)) as progress:
            count = write_frames(entries, out, progress)
        console.out.print(f"{out}: {count} frames", markup=False)
    if verify:
        with console.progress_bar("verifying") as update:
            found = list(find_damage(entries, update))
        for line in found:
            console.out.print(line, markup=False)
        if found:
            raise typer.Exit(1)
        console.out.print(f"every checksum of {len(entries)} datasets holds")


def _rows(entries: list[Entry]) -> list[tuple[str, ...]]:
    """Return a row for each scene; labels are those of all its datasets."""
    scenes: dict[str, list[Entry]] = defaultdict(list)
    for entry in entries:
        scenes[entry.scenes[0]].append(entry)
    return [
        (
            scene,
            str(len(members)),
            _ranges(sorted({x.seed for x in members})),
            str(sum(x.frames for x in members)),
            ", ".join(x for x in members[0].labels if all(x in y.labels for y in members)) or "–",
        )
        for scene, members in scenes.items()
    ]


def _ranges(numbers: list[int]) -> str:
    """Write sorted numbers as 0-9,12."""
    starts = [k for k, x in enumerate(numbers) if k == 0 or x != numbers[k - 1] + 1]
    ends = [*starts[1:], len(numbers)]
    pairs = [(numbers[a], numbers[b - 1]) for a, b in zip(starts, ends, strict=True)]
    return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in pairs)
