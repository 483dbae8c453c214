"""`driftyard report`: runs as an HTML page."""

from pathlib import Path

from trials.cli import console
from trials.cli.options import Dataset, Trajectories, option
from trials.evaluation.runs import read_runs
from trials.report.page import write_report


def report(
    dataset: Dataset,
    files: Trajectories,
    out: Path = option(Path("report.html"), "HTML page to write."),
) -> None:
    """Show runs as one self-contained HTML page, the first file in detail."""
    write_report(dataset, read_runs(dataset, files), out)
    console.out.print(f"{out}")
