"""`driftyard demo`: dataset, estimates, errors and report in one command."""

from pathlib import Path

import driftyard
from sim.batch import DatasetTask
from trials.cli import console
from trials.cli.generate import record_task
from trials.cli.options import Seed, option
from trials.cli.run import run_estimator
from trials.cli.score import score_table
from trials.estimators.choice import COMPARED, Named
from trials.evaluation.dataset_scores import score_runs
from trials.evaluation.runs import read_runs
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import is_recorded
from trials.report.page import write_report

SCENE = "brick_court"


def demo(
    out: Path = option(Path("demo"), "Folder for all results."),
    seed: Seed = 0,
    distance: float = option(21, "Length of the drive, m."),
) -> None:
    """Generate a drive over the brick court, run two estimators, score and report them."""
    settings = recording_settings(SCENE, seed, [f"drive.distance_m={distance}"])
    dataset = out / SCENE
    if is_recorded(dataset, settings):
        console.out.print(f"{dataset}: is there already, and verified")
    else:
        record_task(DatasetTask(SCENE, settings, dataset), overwrite=True)
    files = [out / f"{name}.txt" for name in COMPARED]
    for name, file in zip(COMPARED, files, strict=True):
        run_estimator(driftyard.open(dataset), Named(name), file)
    page = out / "report.html"
    runs = read_runs(dataset, files)
    write_report(dataset, runs, page)
    console.out.print(score_table(SCENE, score_runs(dataset, runs)))
    console.out.print(f"{page.resolve().as_uri()}")
