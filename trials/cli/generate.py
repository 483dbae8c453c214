"""`driftyard generate`: datasets with exact labels, one or many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import typer

from sim.batch import DatasetTask, obtain, record_scene
from sim.certificate.manifest_check import check_digest
from sim.record import Recording
from sim.settings import recorded_settings
from trials.cli import console
from trials.cli.options import RecordingOptions, argument, option
from trials.cli.workers import WorkersOptions
from trials.execution.executor import perform
from trials.execution.jobs import scene_label
from trials.execution.location import Location, StoreError, location_of
from trials.execution.tasks import Task, report_steps
from trials.shards.recordings import Made, folder_tasks, missing, record_at, shard_tasks
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError, DriftyardError, SettingsError


@dataclass(frozen=True)
class BatchOptions:
    """Many datasets at once."""

    PANEL: ClassVar[str] = "Many datasets"
    count: int | None = option(None, "Number of seeds, one dataset for each.", min=1)
    vary: list[str] = option(
        [], "One dataset for each value of a setting; may be repeated.", metavar="KEY=A,B,C"
    )
    shard: int | None = option(
        None, "Write tar files of N datasets each, with an index, not folders.", min=1, metavar="N"
    )


def generate(
    recording: RecordingOptions,
    batch: BatchOptions,
    workers: WorkersOptions,
    scene: str | None = argument(None, "Scene as for `preview`, or several as a,b,c."),
    out: str = option(
        "dataset", "Dataset folder to write, or location: s3://BUCKET/NAME, gs://..., sftp://..."
    ),
    source: Path | None = option(
        None, "Record this dataset again.", "--from", metavar="DATASET.JSON"
    ),
    overwrite: bool = option(False, "Replace an existing dataset."),
) -> None:
    """Drive through a scene, render it and write a dataset folder with exact labels.

    With several scenes, --count, --vary or --shard, each dataset has a name of its own below --out.
    """
    if workers.store:
        raise SettingsError(
            "--store: generate writes its datasets to --out, which takes a location"
        )
    place = location_of(out)
    if source is not None:
        if scene or recording != RecordingOptions() or batch != BatchOptions():
            raise SettingsError("--from: takes scene and settings from the file alone")
        _generate_one(*_task_of(source, Path(out)), overwrite, place)
        return
    if scene is None:
        raise SettingsError("which scene? `driftyard scenes` lists them")
    names = scene.split(",")
    if batch == BatchOptions() and len(names) == 1:
        task = DatasetTask(scene, recording.settings(scene), Path(out))
        _generate_one(task, None, overwrite, place)
        return
    tasks = list(_tasks(names, Path(out), recording, batch))
    if place is None and batch.shard is None:
        _generate_all(tasks)
        return
    if out.startswith("memory:") and workers.workers != 0:
        raise SettingsError(f"--out {out}: is in the memory of one process; add --workers 0")
    if place is None:
        place = Location(out)
        place.check()
        _generate_at(place, tasks, Path(out), batch.shard)
        return
    with replace(workers, store=out).using():  # machines need no common folder
        _generate_at(place, tasks, Path(out), batch.shard)


def record_task(
    task: DatasetTask, overwrite: bool = False, recorded: dict[str, Any] | None = None
) -> Recording:
    """Record a scene with a progress bar; `recorded` is as for `record`."""
    with console.progress_bar(f"recording {task.scene}") as progress:
        return record_scene(task, overwrite, progress, recorded)


def _task_of(manifest: Path, out: Path) -> tuple[DatasetTask, dict[str, Any]]:
    """Read scene and settings of a dataset, and its manifest, from its folder or dataset.json."""
    folder = manifest.parent if manifest.name == MANIFEST else manifest
    content = read_manifest(folder)
    for problem in check_digest(content):
        raise DatasetError(
            f"{folder / MANIFEST}: {problem}; restore it, or record with other settings by "
            "`driftyard generate SCENE --set KEY=VALUE`"
        )
    try:
        source, settings = content["scene"]["source"], content["settings"]
    except (KeyError, TypeError):
        raise DatasetError(f"{folder / MANIFEST}: does not name its scene and settings") from None
    try:
        return DatasetTask(source, recorded_settings(settings), out), content
    except SettingsError as error:
        raise SettingsError(f"{folder / MANIFEST}: {error}") from None


def _tasks(
    names: list[str], out: Path, recording: RecordingOptions, batch: BatchOptions
) -> Iterator[DatasetTask]:
    """Cross scenes, values and seeds; each task has its own folder below `out`."""
    choices: list[list[str]] = []
    for choice in batch.vary:
        key, equals, values = choice.partition("=")
        if not equals or not values:
            raise SettingsError(f"--vary {choice}: expected key=a,b,c")
        choices.append([f"{key}={value}" for value in values.split(",")])
    for name, values in product(names, product(*choices)):
        varied = replace(recording, overrides=[*recording.overrides, *values])
        settings = varied.settings(name)
        for k in range(batch.count or 1):
            chosen = settings.model_copy(update={"seed": settings.seed + k})
            label = "-".join([scene_label(name), *values, f"{chosen.seed:05d}"])
            yield DatasetTask(name, chosen, out / label)


def _generate_one(
    task: DatasetTask, recorded: dict[str, Any] | None, overwrite: bool, place: Location | None
) -> None:
    if place is None:
        name, recording = str(task.out), record_task(task, overwrite, recorded)
    else:
        name = str(place)
        recording = record_at(
            place, overwrite, lambda out: record_task(replace(task, out=out), False, recorded)
        )
    certificate = recording.certificate
    verdict = "certified" if certificate["passed"] else "[bold red]not certified[/]"
    console.out.print(
        f"{name}: median left-right residual {certificate['stereo']['median_grey']:g} grey "
        f"levels, {verdict}"
    )
    _print_faults(name, recording)
    if recording.ended:
        raise typer.Exit(1)


def _generate_all(tasks: list[DatasetTask]) -> None:
    """Record every dataset that does not exist yet."""
    waiting = [task for task in tasks if not task.is_done]
    chosen = [Task("recording", str(x.out), _obtain, (x,)) for x in waiting]
    _perform(chosen, len(tasks) - len(waiting), len(tasks), str(tasks[0].out.parent))


def _generate_at(
    location: Location, tasks: list[DatasetTask], base: Path, shard: int | None
) -> None:
    """Record every dataset that a location does not hold yet."""
    named = [
        replace(x, out=Path(x.out.relative_to(base).as_posix().replace("/", "."))) for x in tasks
    ]
    waiting = missing(location, named)
    chosen = shard_tasks(location, waiting, shard) if shard else folder_tasks(location, waiting)
    _perform(chosen, len(named) - len(waiting), len(named), str(location))


def _perform(tasks: Sequence[Task[list[Made]]], there: int, total: int, place: str) -> None:
    """Run tasks, and print what is wrong with their datasets.

    Raises:
        StoreError: If a location cannot be written any more, as without space.
    """
    if there:
        console.out.print(f"{there} of {total} datasets are there already")
    failed = 0
    with console.batch_bar(len(tasks)) as (advance, finish):
        for outcome in perform(tasks, advance):
            if isinstance(outcome.error, StoreError):
                raise outcome.error
            if outcome.error is not None:
                _print_error(outcome.task.name, outcome.error)
                failed += 1
            for name, made in outcome.value or ():
                failed += _is_failure(name, made)
            finish(outcome.task.name, failed)
    console.out.print(f"{total - failed} datasets in {place}")
    if failed:
        raise typer.Exit(1)


def _obtain(task: DatasetTask) -> list[Made]:
    return [(str(task.out), obtain(task, report_steps()))]


def _is_failure(name: str, made: Recording | DriftyardError) -> bool:
    """Print the faults of a recording, or why there is none."""
    if isinstance(made, DriftyardError):
        _print_error(name, made)
        return True
    _print_faults(name, made)
    return bool(made.ended)


def _print_error(name: str, error: Exception) -> None:
    said = str(error) if isinstance(error, DriftyardError) else f"{type(error).__name__}: {error}"
    text = said if said.startswith(f"{name}: ") else f"{name}: {said}"
    console.err.print(text, markup=False, soft_wrap=True)


def _print_faults(name: str, recording: Recording) -> None:
    for fault in recording.faults:
        console.err.print(f"{name}: {fault}", markup=False, soft_wrap=True)
