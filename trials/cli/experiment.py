"""`driftyard experiment`: claims of the thesis, and the validity of simulation, tested."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, argument, option
from trials.cli.workers import WorkersOptions
from trials.execution.runner import run_jobs
from trials.report.tables import text_table
from trials.studies.experiments import base
from trials.studies.experiments.page import write_html_page, write_page
from trials.studies.experiments.registry import EXPERIMENTS
from trials.studies.validity import summary, table, validate
from trials.studies.validity_page import CLAIM, page_text, write_study
from vo.contract.errors import SettingsError
from vo.contract.files import write_text

VALIDITY = "V1"


@dataclass(frozen=True)
class DriveOptions:
    """The drives of each setting."""

    PANEL: ClassVar[str] = "Drives"
    seeds: int | None = option(None, "Number of drives of each setting.", min=1, show_default="3")
    camera: Camera = DEFAULT_CAMERA
    small: bool = option(False, "Use one short drive of each kind, as a test.")

    @property
    def scale(self) -> base.Scale:
        """Seeds, length and camera of the drives."""
        scale = base.SMALL if self.small else base.FULL
        seeds = tuple(range(self.seeds)) if self.seeds else scale.seeds
        return replace(scale, seeds=seeds, camera=self.camera)


def experiment(
    drives: DriveOptions,
    workers: WorkersOptions,
    which: str = argument(
        ...,
        f"{', '.join(EXPERIMENTS)}, several as a,b,c, or all; {VALIDITY} for the validity study.",
        metavar="ID",
    ),
    out: Path = option(Path("build/experiments"), "Folder of figures, data and records."),
    page: Path | None = option(None, "Markdown page of all records in --out.", metavar="FILE"),
    real: str = option("", f"Real recordings of {VALIDITY}, as a,b,c.", metavar="DATASETS"),
    scenes: str = option("all", f"Scenes that may be twins in {VALIDITY}, as a,b,c, or all."),
) -> None:
    """Test claims of the thesis, or of this simulator: record, run, draw, and state the result."""
    if which.upper() == VALIDITY:
        if drives.camera != DEFAULT_CAMERA:
            raise SettingsError(f"--camera: {VALIDITY} has the cameras that match its recordings")
        _validate(real, scenes, drives.seeds or 2, out, page)
        return
    if real:
        raise SettingsError(f"--real: {which} has no real recordings; only {VALIDITY} has")
    chosen = _chosen(which)
    scale = drives.scale
    folder = out / "small" if drives.small else out  # so that small versions never replace results
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


def _validate(real: str, scenes: str, seeds: int, out: Path, page: Path | None) -> None:
    """Run the validity study over real recordings, and write its files and page."""
    folders = [Path(x) for x in real.split(",") if x]
    if not folders:
        raise SettingsError(f"{VALIDITY} needs real recordings with a ground truth: --real a,b,c")
    with console.stage_bar() as progress:
        found = validate(folders, scenes, seeds, progress)
    write_study(found, out)
    for header, rows in (summary(found), table(found)):
        console.out.print(text_table(header, rows))
    verdict, sentence = found.finding
    console.out.print(f"{CLAIM}\n[bold]The claim {verdict.value}.[/bold] {sentence}")
    console.out.print(f"{out / 'V1.png'}", markup=False)
    if page is not None:
        pictures = page.parent / "images" / "experiments"
        pictures.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(out / "V1.png", pictures / "V1.png")
        write_text(page, page_text(found, "images/experiments/V1.png"))
        console.out.print(f"{page}", markup=False)


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
