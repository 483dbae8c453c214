"""Making and checking datasets: scenes, preview, generate, verify."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from sim.batch import Task
    from sim.record import Recording
    from sim.settings import RecordSettings

SceneName = Annotated[
    str,
    typer.Argument(
        help="Name, as `driftyard scenes` lists it, an MJCF file, or module:function of your own."
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated."),
]
Config = Annotated[Path | None, typer.Option(help="TOML file of settings.")]
Seed = Annotated[int | None, typer.Option(help="Of everything random.", show_default="0")]
Disturb = Annotated[
    str,
    typer.Option(
        metavar="NAME[=STRENGTH],...",
        help="Make it harder, for example blur,brick_bump=0.5; `driftyard scenes` lists all.",
    ),
]


def scenes() -> None:
    """List the scenes and what each tests, and the disturbances."""
    from rich.table import Table

    from scenes import SCENES
    from sim.disturbances import DISTURBANCES
    from trials.cli import console

    table = Table("scene", "tests", box=None)
    for name, builder in SCENES.items():
        table.add_row(name, builder.tests)
    console.out.print(table)
    table = Table("disturbance", "at strength 1", box=None)
    for name, disturbance in DISTURBANCES.items():
        table.add_row(name, disturbance.about)
    console.out.print()
    console.out.print(table)


def generate(
    scene: Annotated[str | None, typer.Argument(help="As for preview; or several, a,b,c.")] = None,
    out: Annotated[Path, typer.Option(help="Folder to write.")] = Path("dataset"),
    seed: Seed = None,
    overrides: Overrides = None,
    config: Config = None,
    disturb: Disturb = "",
    source: Annotated[
        Path | None,
        typer.Option("--from", metavar="DATASET.JSON", help="Make this dataset again."),
    ] = None,
    count: Annotated[
        int | None, typer.Option(min=1, help="Make one dataset for each of so many seeds.")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=A,B,C", help="And one for each value; may be repeated."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes.", show_default="one a core")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler to use instead.")
    ] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a dataset that is there.")] = False,
) -> None:
    """Drive a scene, render it and write a dataset folder with exact labels; or many of them."""
    from vo.contract.errors import SettingsError

    if source is not None:
        if scene or overrides or config or disturb or count or vary or seed is not None:
            raise SettingsError("--from: takes scene and settings from the file alone")
        _generate_one(_task_of(source, out), overwrite)
        return
    if scene is None:
        raise SettingsError("which scene? `driftyard scenes` lists them")
    names = scene.split(",")
    many = count is not None or bool(vary) or len(names) > 1
    tasks = _tasks(names, out, seed, overrides or [], config, disturb, count, vary or [], many)
    if many:
        _generate_all(tasks, scheduler, workers)
    else:
        _generate_one(tasks[0], overwrite)


def verify(dataset: Annotated[Path, typer.Argument(help="Folder that generate wrote.")]) -> None:
    """Recompute every hash and the certificate of a dataset."""
    from sim.certificate.verify import verify as find_faults
    from trials.cli import console

    with console.progress_bar("verifying") as progress:
        findings = find_faults(dataset, progress)
    for finding in findings:
        console.out.print(f"{dataset / finding.file}: {finding.problem}")
    if findings:
        raise typer.Exit(1)
    console.out.print(f"{dataset}: every hash and the certificate hold")


def record_scene(
    name: str, settings: "RecordSettings", out: Path, overwrite: bool = False
) -> "Recording":
    """Record a scene with a progress bar."""
    from sim.batch import build
    from sim.record import record
    from trials.cli import console
    from vo.contract.dataset import DatasetWriter

    DatasetWriter(out, overwrite)  # refuses now what it would refuse after building the scene
    with console.progress_bar(f"recording {name}") as progress:
        return record(build(name, settings), settings, out, overwrite, progress)


def _task_of(manifest: Path, out: Path) -> "Task":
    """Read what a dataset was made from, given its folder or its dataset.json."""
    from sim.batch import Task
    from sim.settings import RecordSettings
    from vo.contract.dataset import MANIFEST, read_manifest
    from vo.contract.errors import DatasetError
    from vo.contract.settings import validated

    folder = manifest.parent if manifest.name == MANIFEST else manifest
    content = read_manifest(folder)
    try:
        source, settings = content["scene"]["source"], content["settings"]
    except (KeyError, TypeError):
        raise DatasetError(f"{folder / MANIFEST}: does not say what it was made from") from None
    return Task(source, validated(RecordSettings, settings), out)


def _tasks(
    names: list[str],
    out: Path,
    seed: int | None,
    overrides: list[str],
    config: Path | None,
    disturb: str,
    count: int | None,
    vary: list[str],
    many: bool,
) -> "list[Task]":
    """Cross scenes, values and seeds; of many, each has its own folder under `out`."""
    from itertools import product

    from sim.batch import Task
    from trials.execution.recording_settings import recording_settings
    from vo.contract.errors import SettingsError

    choices: list[list[str]] = []
    for choice in vary:
        key, equals, values = choice.partition("=")
        if not equals or not values:
            raise SettingsError(f"--vary {choice}: expected key=a,b,c")
        choices.append([f"{key}={value}" for value in values.split(",")])
    tasks: list[Task] = []
    for name, values in product(names, product(*choices)):
        settings = recording_settings(name, seed, [*overrides, *values], config, disturb)
        for k in range(count or 1):
            chosen = settings.model_copy(update={"seed": settings.seed + k})
            label = "-".join([Path(name).stem.replace(":", "."), *values, f"{chosen.seed:05d}"])
            tasks.append(Task(name, chosen, out / label if many else out))
    return tasks


def _generate_one(task: "Task", overwrite: bool) -> None:
    from trials.cli import console

    recording = record_scene(task.scene, task.settings, task.out, overwrite)
    certificate = recording.certificate
    console.out.print(
        f"{task.out}: median left-right residual {certificate['stereo']['median_grey']:g} grey "
        f"levels, {_verdict(recording)}"
    )
    _complain(task.out, recording)
    if recording.ended:
        raise typer.Exit(1)


def _generate_all(tasks: "list[Task]", scheduler: str | None, workers: int | None) -> None:
    """Make every dataset that is not there yet."""
    from sim.batch import perform_all
    from trials.cli import console

    waiting = [task for task in tasks if not task.is_done]
    if len(waiting) < len(tasks):
        console.out.print(f"{len(tasks) - len(waiting)} of {len(tasks)} datasets are there already")
    failed = 0
    if waiting:
        with console.fleet_bar(len(waiting)) as (advance, finish):
            for outcome in perform_all(waiting, scheduler, workers, advance):
                finish(outcome.task.out)
                if outcome.recording is None:
                    console.err.print(f"{outcome.task.out}: {outcome.problem}")
                else:
                    _complain(outcome.task.out, outcome.recording)
                failed += bool(outcome.problem)
    console.out.print(f"{len(tasks) - failed} datasets in {tasks[0].out.parent}")
    if failed:
        raise typer.Exit(1)


def _verdict(recording: "Recording") -> str:
    return "certified" if recording.certificate["passed"] else "[bold red]not certified[/]"


def _complain(out: Path, recording: "Recording") -> None:
    """Say what is wrong with a dataset that was written nevertheless."""
    from trials.cli import console

    if recording.ended:
        console.err.print(f"{out}: incomplete, {recording.ended}")
    for name, part in recording.certificate.items():
        if isinstance(part, dict) and not part["passed"]:
            frames = part.get("failed_frames_ns", [])
            where = f", first at {frames[0]} ns" if frames else ""
            console.err.print(f"{out}: the {name} check of the certificate fails{where}")
