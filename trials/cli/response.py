"""`driftyard response`: drift of the baseline under every disturbance and on every scene."""

from pathlib import Path

from trials.cli import console
from trials.cli.options import option
from trials.execution.jobs import jobs_of
from trials.execution.runner import run_jobs
from trials.studies.response import (
    BASELINE,
    disturbance_table,
    draw,
    drive,
    respond,
    scene_table,
    settings_of,
)


def response(
    distance: float = option(4.0, "Length of each drive, m.", min=1.5),
    seeds: int = option(2, "Number of drives of each setting.", min=1),
    first_seed: int = option(0, "Random seed of the first drive.", min=0),
    only: str = option("", "Disturbances and scenes; all by default.", metavar="A,B,C"),
    out: Path = option(Path("build/response.png"), "PNG of the curves."),
) -> None:
    """Record or reuse drives, run the baseline over them, print a table and draw the curves.

    Without --only, it takes hours.
    """
    settings = settings_of([name for name in only.split(",") if name])
    seeded = range(first_seed, first_seed + seeds)
    drives = {(x, seed): drive(x, seed, distance) for x in settings for seed in seeded}
    with console.counting_bar("drives", len(drives)) as count:
        results = run_jobs(jobs_of(drives.values(), [BASELINE]), progress=count)
    found = {x: [respond(results.at(drives[x, seed], BASELINE)) for seed in seeded]
             for x in settings}  # fmt: skip
    console.out.print(scene_table(found))
    console.out.print(disturbance_table(found))
    draw(found, out)
    console.out.print(f"{out}")
