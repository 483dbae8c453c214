"""Everything in one command."""

from pathlib import Path
from typing import Annotated

import typer

from trials.cli.datasets import record_scene
from trials.cli.runs import run_estimator, score_files
from trials.execution.recording_settings import recording_settings

SCENE = "brick_court"
DISTANCE_M = 21
ESTIMATORS = ("driftyard", "corner_flow")


def demo(
    out: Annotated[Path, typer.Option(help="Folder for all results.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Of everything random.")] = 0,
    distance: Annotated[float, typer.Option(help="Of the drive, metres.")] = DISTANCE_M,
) -> None:
    """Generate a drive over the brick court, run both estimators, score them and report."""
    from trials.cli import console
    from trials.evaluation.runs import read_run
    from trials.execution.runner import is_recorded
    from trials.report.page import write_report

    settings = recording_settings(SCENE, seed, [f"drive.distance_m={distance}"], None)
    dataset = out / SCENE
    if is_recorded(dataset, settings):
        console.out.print(f"{dataset}: is there already, and verified")
    else:
        record_scene(SCENE, settings, dataset, overwrite=True)
    files = [out / f"{name}.txt" for name in ESTIMATORS]
    for name, file in zip(ESTIMATORS, files, strict=True):
        run_estimator(dataset, file, name, [])
    page = out / "report.html"
    write_report(dataset, [read_run(file) for file in files], page)
    console.out.print(console.score_table(SCENE, score_files(dataset, files)))
    console.out.print(f"{page.resolve().as_uri()}")
