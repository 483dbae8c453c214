"""`driftyard accuracy`: drift of the default settings on many drives."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import ClassVar

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Distance, Disturb, Scenes, changes, option
from trials.cli.workers import WorkersOptions
from trials.execution.jobs import Job, Recording, Result, jobs_of
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import NO_LABELS, cached_run, run_jobs
from trials.execution.variants import named_variant
from trials.report.columns import check_columns
from trials.report.score_tables import write_drives, write_segments
from trials.studies.accuracy import (
    SCENES,
    VARIANTS,
    accuracy_table,
    consistency_table,
    summary_tables,
    write_scores,
    wrong_steps_table,
)
from vo.recordings.readers import open_sequence


@dataclass(frozen=True)
class DriveOptions:
    """Drives through scenes."""

    PANEL: ClassVar[str] = "Drives"
    distance: Distance = 20.0
    seeds: int = option(5, "Number of drives in each scene.", min=1)
    first_seed: int = option(0, "Random seed of the first.", min=0)
    scenes: Scenes = SCENES
    camera: Camera = DEFAULT_CAMERA
    disturb: Disturb = ""
    overrides: list[str] = changes("recording")

    def recordings(self, names: Sequence[str]) -> list[Recording]:
        """Return the drives through scenes, each with every seed."""
        fixed = (f"drive.distance_m={self.distance:g}", *NO_LABELS)
        settings = (*fixed, *self.overrides)
        pairs = product(names, range(self.first_seed, self.first_seed + self.seeds))
        return [Recording(x, seed, settings, self.disturb, self.camera) for x, seed in pairs]


def accuracy(
    chosen: DriveOptions,
    workers: WorkersOptions,
    against: list[str] = option(
        [],
        "Another estimator in the tables, with its settings; may be repeated.",
        metavar="'NAME KEY=VALUE ...'",
    ),
    kitti: list[Path] = option(
        [], "Recording that is scored, too; may be repeated.", metavar="DATASET"
    ),
    out: Path | None = option(None, "JSON file of all scores.", "--json", metavar="FILE"),
    drive_table: Path | None = option(
        None, "Table of one row for each drive, .parquet or .csv.", metavar="FILE"
    ),
    segment_table: Path | None = option(
        None, "Table of one row for each segment, .parquet or .csv.", metavar="FILE"
    ),
) -> None:
    """Record or reuse drives of successive seeds, run all estimators over them, print errors."""
    names = parse_scenes(chosen.scenes)
    tables = [(drive_table, write_drives), (segment_table, write_segments)]
    for path, _ in tables:
        if path is not None:
            check_columns(path)  # before the drives
    for path in kitti:
        open_sequence(path)  # a wrong one is refused before the drives
    variants = tuple(dict.fromkeys((*VARIANTS, *map(named_variant, against))))
    drives = chosen.recordings(names)
    with console.counting_bar("drives", len(drives)) as count:
        results = run_jobs(jobs_of(drives, variants), progress=count)
    runs = {name: [x for v in variants for x in results.of(v, name)] for name in names}
    for path in kitti:
        of_kitti = Recording(path.resolve().name, 0)
        runs[of_kitti.scene] = [
            Result(Job(of_kitti, v), path, cached_run(path, v)) for v in variants
        ]
    for name, of_scene in runs.items():
        console.out.print(accuracy_table(name, of_scene))
    for table in summary_tables(runs):
        console.out.print(table)
    console.out.print(wrong_steps_table(runs))
    console.out.print(consistency_table(runs))
    if out is not None:
        write_scores(out, runs)
    for path, write in tables:
        if path is not None:
            write(path, [x for of_scene in runs.values() for x in of_scene])
