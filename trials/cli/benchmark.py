"""`driftyard benchmark`: estimators on all recordings of a published data set."""

import shlex
import sys
from pathlib import Path

from trials.cli import console
from trials.cli.options import argument, option
from trials.cli.workers import WorkersOptions
from trials.report.tables import text_table
from trials.studies.benchmark import (
    KINDS,
    PUBLISHED,
    recordings_of,
    run_benchmark,
    variants_of,
    write_benchmark,
)


def benchmark(
    workers: WorkersOptions,
    kind: str = argument(..., f"Benchmark: {', '.join(KINDS)}.", metavar="KIND"),
    folder: Path = argument(..., "Folder of recordings, as published or excerpts; at any depth."),
    estimator: list[str] = option(
        ["driftyard"],
        "Estimators a,b, or one with its settings; may be repeated.",
        metavar="'NAME KEY=VALUE ...'",
    ),
    seeds: int = option(3, "Number of runs, with seeds of RANSAC from 0 on.", min=1),
    out: Path = option(Path("build/benchmark"), "Folder of the tables."),
) -> None:
    """Run estimators over every recording of a folder; print and write the benchmark's table.

    The same command continues after an interruption. Frames whose images are missing are left out.
    """
    recordings = recordings_of(kind, folder)
    variants = variants_of(estimator, seeds)
    runs = len(recordings) * sum(map(len, variants))
    with console.counting_bar(f"{kind}: runs", runs) as count:
        found = run_benchmark(kind, recordings, variants, count)
    for figure in KINDS[kind].figures:
        console.out.print(text_table(*found.table(figure), figure.label))
    header, rows, sources = found.published()
    if rows:
        console.out.print(text_table(header, rows, PUBLISHED))
    for line in (*sources, *found.notes):
        console.out.print(line, markup=False)
    for line in found.problems:
        console.err.print(line, markup=False)
    for file in write_benchmark(found, out, shlex.join(["driftyard", *sys.argv[1:]])):
        console.out.print(f"{file}", markup=False)
