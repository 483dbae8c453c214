"""Making and checking datasets: scenes, preview, generate, verify."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from scenes.scene import Scene
    from sim.record import Recording
    from sim.settings import RecordSettings

SceneName = Annotated[str, typer.Argument(help="Name, as `driftyard scenes` lists it.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated."),
]
Config = Annotated[Path | None, typer.Option(help="TOML file of settings.")]
Seed = Annotated[int | None, typer.Option(help="Of everything random.", show_default="0")]


def scenes() -> None:
    """List the scenes and what each tests."""
    from rich.table import Table

    from scenes import SCENES
    from trials.commands import console

    table = Table("scene", "tests", box=None)
    for name, builder in SCENES.items():
        table.add_row(name, builder.tests)
    console.out.print(table)


def preview(
    scene: SceneName,
    out: Annotated[Path, typer.Option(help="PNG to write.")] = Path("preview.png"),
    seed: Seed = None,
    overrides: Overrides = None,
    config: Config = None,
) -> None:
    """Render a contact sheet of what the rover will see, and the map from above, as one PNG."""
    from sim.preview import preview as render_sheet
    from trials.commands import console

    settings = record_settings(scene, seed, overrides or [], config)
    render_sheet(build(scene, settings), settings, out)
    console.out.print(f"{out}")


def generate(
    scene: SceneName,
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    seed: Seed = None,
    overrides: Overrides = None,
    config: Config = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a dataset that is there.")] = False,
) -> None:
    """Drive a scene, render it and write a dataset folder with exact labels."""
    from trials.commands import console

    settings = record_settings(scene, seed, overrides or [], config)
    recording = record_scene(scene, settings, out, overwrite)
    certificate = recording.certificate
    console.out.print(
        f"{out}: median left-right residual {certificate['stereo']['median_grey']:g} grey levels, "
        + ("certified" if certificate["passed"] else "[bold red]not certified[/]")
    )
    if recording.ended:
        console.err.print(f"{out}: incomplete, {recording.ended}")
        raise typer.Exit(1)


def verify(dataset: Annotated[Path, typer.Argument(help="Folder that generate wrote.")]) -> None:
    """Recompute every hash and the certificate of a dataset."""
    from sim.verify import verify as find_faults
    from trials.commands import console

    with console.progress_bar("verifying") as progress:
        findings = find_faults(dataset, progress)
    for finding in findings:
        console.out.print(f"{dataset / finding.file}: {finding.problem}")
    if findings:
        raise typer.Exit(1)
    console.out.print(f"{dataset}: every hash and the certificate hold")


def record_settings(
    scene: str, seed: int | None, overrides: list[str], config: Path | None
) -> "RecordSettings":
    """Resolve what a dataset of a scene is made from.

    Raises:
        SettingsError: If there is no such scene, or a key or value is not accepted.
    """
    from scenes import find_scene
    from sim.settings import RecordSettings
    from vo.contract.settings import resolve

    seeded = [] if seed is None else [f"seed={seed}"]
    return resolve(RecordSettings, config, [*overrides, *seeded], find_scene(scene).defaults)


def build(name: str, settings: "RecordSettings") -> "Scene":
    """Build a scene from its own stream of random numbers.

    Raises:
        SettingsError: If there is no such scene or option.
    """
    from scenes import build_scene
    from sim.streams import stream

    return build_scene(name, stream(settings.seed, "scene"), settings.scene)


def record_scene(
    name: str, settings: "RecordSettings", out: Path, overwrite: bool = False
) -> "Recording":
    """Record a scene with a progress bar."""
    from sim.record import record
    from trials.commands import console
    from vo.contract.dataset import DatasetWriter

    DatasetWriter(out, overwrite)  # refuses now what it would refuse after building the scene

    with console.progress_bar(f"recording {name}") as progress:
        return record(build(name, settings), settings, out, overwrite, progress)
