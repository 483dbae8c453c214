"""`driftyard accuracy`: drift of the default settings on many drives."""

from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from trials.cli import console
from trials.cli.options import Distance, Scenes
from trials.execution.jobs import Job, Recording, Result, jobs_of
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import NO_LABELS, cached_run, run_jobs
from trials.studies.accuracy import (
    SCENES,
    VARIANTS,
    accuracy_table,
    named_variant,
    summary_tables,
    write_scores,
)
from vo.contract.readers import open_sequence


def accuracy(
    distance: Distance = 20.0,
    seeds: Annotated[int, typer.Option(min=1, help="Number of drives in each scene.")] = 5,
    scenes: Scenes = SCENES,
    disturb: Annotated[
        str, typer.Option(metavar="NAME[=STRENGTH],...", help="Disturbances, as for `generate`.")
    ] = "",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE",
            help="Change a setting of `driftyard settings recording`; may be repeated.",
        ),
    ] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME KEY=VALUE ...'",
            help="Another estimator in the tables, with its settings; may be repeated.",
        ),
    ] = None,
    kitti: Annotated[
        Path | None, typer.Option(metavar="DATASET", help="Recording that is scored, too.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="JSON file of all scores.")
    ] = None,
) -> None:  # fmt: skip
    """Record or reuse drives from seed 0 on, run every estimator over them, print the errors."""
    names = parse_scenes(scenes)
    if kitti is not None:
        open_sequence(kitti)  # a wrong path is refused before the drives
    variants = tuple(dict.fromkeys((*VARIANTS, *map(named_variant, against or ()))))
    settings = (f"drive.distance_m={distance:g}", *NO_LABELS, *(overrides or ()))
    drives = [Recording(x, seed, settings, disturb) for x, seed in product(names, range(seeds))]
    with console.counting_bar("drives", len(drives)) as count:
        results = run_jobs(jobs_of(drives, variants), progress=count)
    runs = {name: [x for v in variants for x in results.of(v, name)] for name in names}
    if kitti is not None:
        of_kitti = Recording(kitti.resolve().name, 0)
        runs[of_kitti.scene] = [
            Result(Job(of_kitti, v), kitti, cached_run(kitti, v)) for v in variants
        ]
    for name, of_scene in runs.items():
        console.out.print(accuracy_table(name, of_scene))
    for table in summary_tables(runs):
        console.out.print(table)
    if out is not None:
        write_scores(out, runs)
