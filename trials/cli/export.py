"""`driftyard export`: datasets in the formats of other tools."""

from pathlib import Path

from trials.cli import console
from trials.cli.completion import one_of
from trials.cli.options import FrameOptions, argument, option
from trials.formats.registry import FORMATS
from trials.formats.registry import export as write


def export(
    frames: FrameOptions,
    datasets: list[Path] = argument(
        ..., "Recordings, as `driftyard run` takes them.", metavar="DATASET..."
    ),
    to: str = option(
        ...,
        f"Format: {', '.join(FORMATS)}.",
        metavar="FORMAT",
        autocompletion=one_of(lambda: FORMATS),
    ),
    out: Path = option(..., "Folder to write; it must not exist.", metavar="FOLDER"),
) -> None:
    """Write datasets in the format of another tool, with true poses and labels.

    Of several datasets, each has a folder of its name in FOLDER, which appears when all is written.
    """
    with console.progress_bar(f"exporting to {to}") as progress:
        count = write(datasets, to, out, frames.selection, progress)
    console.out.print(f"{out}: {count} frames, {FORMATS[to].summary}", markup=False)
