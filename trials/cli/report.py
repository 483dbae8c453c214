"""`driftyard report`: runs as an HTML page."""

from pathlib import Path
from typing import Annotated

import typer

from trials.cli import console
from trials.cli.options import Dataset, Trajectories
from trials.evaluation.runs import read_run
from trials.report.page import write_report


def report(
    dataset: Dataset,
    files: Trajectories,
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("report.html"),
) -> None:
    """Show runs as one self-contained HTML page, the first file in detail."""
    write_report(dataset, [read_run(file) for file in files], out)
    console.out.print(f"{out}")
