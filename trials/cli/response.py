"""`driftyard response`: drift of the baseline under every disturbance and on every scene."""

from pathlib import Path

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, option
from trials.cli.workers import WorkersOptions
from trials.studies.response import (
    disturbance_table,
    draw_responses,
    measure,
    scene_table,
    settings_of,
)


def response(
    workers: WorkersOptions,
    distance: float = option(4.0, "Length of each drive, m.", min=1.5),
    seeds: int = option(2, "Number of drives of each setting.", min=1),
    first_seed: int = option(0, "Random seed of the first drive.", min=0),
    camera: Camera = DEFAULT_CAMERA,
    only: str = option("", "Disturbances and scenes; all by default.", metavar="A,B,C"),
    out: Path = option(Path("build/response.png"), "PNG of the curves."),
) -> None:
    """Record or reuse drives, run the baseline over them, print a table and draw the curves.

    Without --only, it takes hours.
    """
    settings = settings_of([name for name in only.split(",") if name])
    seeded = range(first_seed, first_seed + seeds)
    with console.counting_bar("drives", len(settings) * seeds) as count:
        found = measure(settings, seeded, distance, camera, count)
    console.out.print(scene_table(found))
    console.out.print(disturbance_table(found))
    draw_responses(found, out)
    console.out.print(f"{out}")
