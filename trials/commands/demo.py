"""Everything in one command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.commands.datasets import record_scene, record_settings
from trials.commands.runs import run_estimator, score_files

if TYPE_CHECKING:
    from sim.settings import RecordSettings

SCENE = "brick_court"
DISTANCE_M = 21
ESTIMATORS = ("driftyard", "corner_flow")


def demo(
    out: Annotated[Path, typer.Option(help="Folder for all results.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Of everything random.")] = 0,
    distance: Annotated[float, typer.Option(help="Of the drive, metres.")] = DISTANCE_M,
) -> None:
    """Generate a drive over the brick court, run both estimators, score them and report."""
    from trials.commands import console
    from trials.report.page import write_report
    from trials.runs import read_run

    settings = record_settings(SCENE, seed, [f"drive.distance_m={distance}"], None)
    dataset = out / SCENE
    if _is_recorded(dataset, settings):
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


def _is_recorded(dataset: Path, settings: "RecordSettings") -> bool:
    """Whether the folder was recorded with these settings and is sound."""
    from sim.verify import verify
    from trials.commands import console
    from vo.contract.dataset import read_manifest
    from vo.contract.errors import DatasetError

    try:
        if read_manifest(dataset).get("settings") != settings.model_dump(mode="json"):
            return False
        with console.progress_bar("verifying") as progress:
            return not verify(dataset, progress)
    except DatasetError:
        return False
