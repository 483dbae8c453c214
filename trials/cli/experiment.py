"""`driftyard experiment`: claims of the thesis, tested."""

from dataclasses import replace
from pathlib import Path

from trials.cli import console
from trials.cli.options import argument, option
from trials.cli.workers import WorkersOptions
from trials.execution.runner import run_jobs
from trials.report.tables import text_table
from trials.studies.experiments import base
from trials.studies.experiments.page import write_html_page, write_page
from trials.studies.experiments.registry import EXPERIMENTS
from vo.contract.errors import SettingsError


def experiment(
    workers: WorkersOptions,
    which: str = argument(
        ..., f"{', '.join(EXPERIMENTS)}, several as a,b,c, or all.", metavar="ID"
    ),
    out: Path = option(Path("build/experiments"), "Folder of figures, data and records."),
    seeds: int | None = option(None, "Number of drives of each setting.", min=1, show_default="3"),
    page: Path | None = option(None, "Markdown page of all records in --out.", metavar="FILE"),
    small: bool = option(False, "Use one short drive of each kind, as a test."),
) -> None:
    """Test claims of the thesis: record, run, draw, and state whether each claim holds."""
    chosen = _chosen(which)
    scale = base.SMALL if small else base.FULL
    scale = replace(scale, seeds=tuple(range(seeds))) if seeds else scale
    folder = out / "small" if small else out  # so that small versions never replace results
    for one in chosen:
        jobs = one.jobs(scale)
        with console.counting_bar(one.id, len({x.recording for x in jobs})) as count:
            results = run_jobs(jobs, progress=count)
        _print(base.write_record(one, results, scale, folder), folder)
    files = [file for name in EXPERIMENTS if (file := folder / f"{name}.json").is_file()]
    records = [base.read_record(file) for file in files]
    write_html_page(records, folder, folder / "report.html")
    console.out.print(f"{folder / 'report.html'}")
    if page is not None:
        write_page(records, folder, page)
        console.out.print(f"{page}")


def _chosen(which: str) -> list[base.Experiment]:
    names = list(EXPERIMENTS) if which == "all" else [x for x in which.upper().split(",") if x]
    for name in names:
        if name not in EXPERIMENTS:
            raise SettingsError(f"unknown experiment {name}; valid: all, {', '.join(EXPERIMENTS)}")
    return [EXPERIMENTS[name] for name in names]


def _print(record: base.Record, folder: Path) -> None:
    title = f"{record.id}. {record.title}"
    console.out.print(text_table(record.table.columns, record.table.rows, title))
    console.out.print(
        f"{record.claim}\n[bold]The claim {record.verdict.value}.[/bold] {record.sentence}"
    )
    console.out.print(f"{folder / record.figure}\n")
