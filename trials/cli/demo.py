"""`driftyard demo`: dataset, estimates, errors and report in one command."""

from pathlib import Path

from trials.cli import console
from trials.cli.generate import record_scene
from trials.cli.options import Seed, option
from trials.cli.run import run_estimator
from trials.cli.score import score_files, score_table
from trials.estimators.choice import COMPARED, Named
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
        record_scene(SCENE, settings, dataset, overwrite=True)
    files = [out / f"{name}.txt" for name in COMPARED]
    for name, file in zip(COMPARED, files, strict=True):
        run_estimator(dataset, file, Named(name))
    page = out / "report.html"
    write_report(dataset, read_runs(dataset, files), page)
    console.out.print(score_table(SCENE, score_files(dataset, files)))
    console.out.print(f"{page.resolve().as_uri()}")
