"""`driftyard match`: the simulated camera that comes nearest to a real recording."""

import json
from pathlib import Path

import typer

import driftyard
from trials.cli import console
from trials.cli.options import Dataset, Scenes, option
from trials.realism.camera_match import CameraMatch
from trials.report.tables import text_table


def match(
    real: Dataset,
    out: Path = option(Path("camera.toml"), "File of settings to write, for --camera."),
    scenes: Scenes = "all",
    no_scenes: bool = option(False, "Estimate the camera alone.", "--no-scenes"),
    frames: int = option(100, "Largest number of frames of the recording.", min=2),
    page: Path | None = option(
        None, "HTML page of the recording beside the nearest scene.", metavar="FILE"
    ),
    figure: Path | None = option(
        None, "Image of both, and of their distances.", metavar="FILE.png"
    ),
    as_json: bool = option(False, "Print everything as JSON.", "--json"),
) -> None:
    """Estimate sensor, lens and light of a real recording, and find the nearest scene."""
    with console.progress_bar("measuring") as progress:
        found = driftyard.match(
            *(real, out),
            scenes="" if no_scenes else scenes,
            frames=frames,
            page=page,
            figure=figure,
            progress=progress,
        )
    if as_json:
        typer.echo(json.dumps(found.to_dict(), indent=1, allow_nan=False))
    else:
        _print(found, out)


def _print(found: CameraMatch, out: Path) -> None:
    console.out.print(text_table(*found.table()))
    for k, (scene, distance) in enumerate(found.scenes.items()):
        console.out.print(f"{'nearest scene' if k == 0 else 'scene':14} {scene}: {distance:.3f}")
    if ratios := found.ratios:
        text = ", ".join(f"{name} {x:.2f}" for name, x in ratios.items())
        console.out.print(f"distance, ratio to the default picture: {text}", markup=False)
    for line in found.unmatched:
        console.out.print(f"not matched: {line}", markup=False)
    console.out.print(f"{out}", markup=False)
    if command := found.twin_command(str(out)):
        console.out.print(f"record a twin: {command}", markup=False, soft_wrap=True)
