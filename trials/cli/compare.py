"""`driftyard compare`: how far a simulated recording is from a real one."""

import json
from pathlib import Path

import typer

import driftyard
from trials.cli import console
from trials.cli.options import Dataset, argument, option
from trials.realism.comparison import FRAMES
from trials.report.tables import text_table


def compare(
    real: Dataset,
    simulated: Path = argument(..., "Simulated recording, or any other one."),
    out: Path = option(Path("compare.html"), "HTML page to write."),
    frames: int = option(FRAMES, "Largest number of frames of each recording.", min=2),
    as_json: bool = option(False, "Print everything as JSON, and write no page.", "--json"),
) -> None:
    """Compare statistics of a simulated recording with those of a real one, without truth."""
    with console.progress_bar("measuring") as progress:
        found = driftyard.compare(
            real, simulated, None if as_json else out, frames=frames, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(found.to_dict(), indent=1, allow_nan=False))
        return
    console.out.print(text_table(*found.table()))
    console.out.print(f"{out}", markup=False)
