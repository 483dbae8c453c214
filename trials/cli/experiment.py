"""Testing the thesis' claims: `driftyard experiment`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from trials.studies.experiments.base import Experiment
    from trials.studies.experiments.record import Record

SMALL_FOLDER = "small"
"""Where small versions go, so that they never replace results."""


def experiment(
    which: Annotated[
        str, typer.Argument(metavar="ID", help="E1 to E12, F2, F9, F, several as a,b,c, or all.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of figures, data and records.")] = Path(
        "build/experiments"
    ),
    seeds: Annotated[int | None, typer.Option(min=1, help="Drives of every setting.",
                                              show_default="3")] = None,
    page: Annotated[Path | None, typer.Option(
        help="Also write this Markdown page of all records in the folder.")] = None,
    small: Annotated[bool, typer.Option(
        help="One short drive of everything: to see that it runs.")] = False,
) -> None:  # fmt: skip
    """Test claims of the thesis: record, run, draw, and say whether each holds."""
    from dataclasses import replace

    from trials.cli import console
    from trials.execution.runner import run_jobs
    from trials.studies.experiments.base import FULL, SMALL
    from trials.studies.experiments.record import write_record

    chosen = _chosen(which)
    scale = SMALL if small else FULL
    scale = replace(scale, seeds=tuple(range(seeds))) if seeds else scale
    folder = out / SMALL_FOLDER if small else out
    for one in chosen:
        jobs = one.jobs(scale)
        with console.counting_bar(one.id, len({x.recording for x in jobs})) as count:
            results = run_jobs(jobs, progress=count)
        record = write_record(one, results, scale, folder)
        _print(record, folder)
    _write_pages(folder, page)


def _chosen(which: str) -> "list[Experiment]":
    from trials.studies.experiments.registry import EXPERIMENTS
    from vo.contract.errors import SettingsError

    names = list(EXPERIMENTS) if which == "all" else [x for x in which.upper().split(",") if x]
    for name in names:
        if name not in EXPERIMENTS:
            raise SettingsError(f"unknown experiment {name}; valid: all, {', '.join(EXPERIMENTS)}")
    return [EXPERIMENTS[name] for name in names]


def _print(record: "Record", folder: Path) -> None:
    from rich.table import Table

    from trials.cli import console

    table = Table(*record.table.columns, title=f"{record.id}. {record.title}", title_justify="left")
    for column in table.columns[1:]:
        column.justify = "right"
    for row in record.table.rows:
        table.add_row(*row)
    console.out.print(table)
    console.out.print(
        f"{record.claim}\n[bold]The claim {record.verdict.value}.[/bold] {record.sentence}"
    )
    console.out.print(f"{folder / record.figure}\n")


def _write_pages(folder: Path, page: Path | None) -> None:
    from trials.cli import console
    from trials.studies.experiments.page import write_html_page, write_page
    from trials.studies.experiments.record import read_record
    from trials.studies.experiments.registry import EXPERIMENTS

    files = [file for name in EXPERIMENTS if (file := folder / f"{name}.json").is_file()]
    records = [read_record(file) for file in files]
    write_html_page(records, folder, folder / "report.html")
    console.out.print(f"{folder / 'report.html'}")
    if page is not None:
        write_page(records, folder, page)
        console.out.print(f"{page}")
