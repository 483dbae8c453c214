"""`driftyard generate`: datasets with exact labels, one or many."""

from collections.abc import Iterator
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
from trials.execution.executor import Outcome, perform
from trials.execution.jobs import scene_label
from trials.execution.tasks import Task, report_steps
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


def generate(
    recording: RecordingOptions,
    batch: BatchOptions,
    workers: WorkersOptions,
    scene: str | None = argument(None, "Scene as for `preview`, or several as a,b,c."),
    out: Path = option(Path("dataset"), "Dataset folder to write."),
    source: Path | None = option(
        None, "Record this dataset again.", "--from", metavar="DATASET.JSON"
    ),
    overwrite: bool = option(False, "Replace an existing dataset."),
) -> None:
    """Drive through a scene, render it and write a dataset folder with exact labels.

    With several scenes, --count or --vary, each dataset has a folder of its own below --out.
    """
    if source is not None:
        if scene or recording != RecordingOptions() or batch.count or batch.vary:
            raise SettingsError("--from: takes scene and settings from the file alone")
        _generate_one(*_task_of(source, out), overwrite=overwrite)
        return
    if scene is None:
        raise SettingsError("which scene? `driftyard scenes` lists them")
    names = scene.split(",")
    if batch.count is None and not batch.vary and len(names) == 1:
        _generate_one(DatasetTask(scene, recording.settings(scene), out), None, overwrite)
    else:
        _generate_all(list(_tasks(names, out, recording, batch)))


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


def _generate_one(task: DatasetTask, recorded: dict[str, Any] | None, overwrite: bool) -> None:
    recording = record_task(task, overwrite, recorded)
    certificate = recording.certificate
    verdict = "certified" if certificate["passed"] else "[bold red]not certified[/]"
    console.out.print(
        f"{task.out}: median left-right residual {certificate['stereo']['median_grey']:g} grey "
        f"levels, {verdict}"
    )
    _print_faults(task.out, recording)
    if recording.ended:
        raise typer.Exit(1)


def _generate_all(tasks: list[DatasetTask]) -> None:
    """Record every dataset that does not exist yet."""
    waiting = [task for task in tasks if not task.is_done]
    if len(waiting) < len(tasks):
        console.out.print(f"{len(tasks) - len(waiting)} of {len(tasks)} datasets are there already")
    failed = 0
    chosen = [Task("recording", str(x.out), _obtain, (x,)) for x in waiting]
    with console.batch_bar(len(waiting)) as (advance, finish):
        for outcome in perform(chosen, advance):
            finish(outcome.task.name, failed := failed + _is_failure(outcome))
    console.out.print(f"{len(tasks) - failed} datasets in {tasks[0].out.parent}")
    if failed:
        raise typer.Exit(1)


def _obtain(task: DatasetTask) -> Recording:
    return obtain(task, report_steps())


def _is_failure(outcome: Outcome[Recording]) -> bool:
    """Print the faults of a recording, or why there is none."""
    name, error = outcome.task.name, outcome.error
    if error is not None:
        said = (
            str(error) if isinstance(error, DriftyardError) else f"{type(error).__name__}: {error}"
        )
        text = said if said.startswith(f"{name}: ") else f"{name}: {said}"
        console.err.print(text, markup=False, soft_wrap=True)
        return True
    recording = outcome.result()
    _print_faults(Path(name), recording)
    return bool(recording.ended)


def _print_faults(out: Path, recording: Recording) -> None:
    for fault in recording.faults:
        console.err.print(f"{out}: {fault}", markup=False, soft_wrap=True)
