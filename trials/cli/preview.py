"""Looking at a scene before it is recorded: preview."""

from pathlib import Path
from typing import Annotated

import typer

from trials.cli.datasets import Config, Disturb, Overrides, Seed

ALL = "all"
"""Instead of a scene's name: one picture of every registered scene."""


def preview(
    scene: Annotated[
        str,
        typer.Argument(help="As for generate; or `all` for one picture of every scene."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="PNG or JPEG to write.", show_default="preview.png, unless --film"),
    ] = None,
    film: Annotated[
        Path | None, typer.Option(metavar="FILE", help="MP4 or GIF of the drive's first seconds.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.2, help="Length of the film.")] = 8.0,
    seed: Seed = None,
    overrides: Overrides = None,
    config: Config = None,
    disturb: Disturb = "",
) -> None:
    """Render a contact sheet of views, labels and map, or a short film, before recording."""
    from sim.batch import build
    from sim.preview.film import film_suffix, make_film
    from sim.preview.image_file import picture_suffix
    from sim.preview.preview import preview as render_sheet
    from trials.cli import console
    from trials.execution.recording_settings import recording_settings
    from vo.contract.errors import SettingsError

    sheet = Path("preview.png") if out is None and film is None else out
    if sheet is not None:
        picture_suffix(sheet)
    if film is not None:
        film_suffix(film)
    if scene == ALL:
        if film is not None or sheet is None:
            raise SettingsError("--film: shows one scene, not all")
        _preview_all(sheet, seed, overrides or [], config, disturb)
        return
    settings = recording_settings(scene, seed, overrides or [], config, disturb)
    built = build(scene, settings)
    if sheet is not None:
        render_sheet(built, settings, sheet)
        console.out.print(f"{sheet}")
    if film is not None:
        with console.progress_bar(f"filming {built.name}") as progress:
            make_film(built, settings, film, seconds, progress)
        console.out.print(f"{film}")


def _preview_all(
    out: Path, seed: int | None, overrides: list[str], config: Path | None, disturb: str
) -> None:
    """Picture every registered scene with its own settings."""
    from scenes import SCENES
    from sim.batch import build
    from sim.preview.image_file import write_picture
    from sim.preview.overview import overview, tile
    from trials.cli import console
    from trials.execution.recording_settings import recording_settings

    tiles = []
    with console.counting_bar("scenes", len(SCENES)) as advance:
        for name in SCENES:
            settings = recording_settings(name, seed, overrides, config, disturb)
            tiles.append(tile(build(name, settings), settings))
            advance(name)
    write_picture(out, overview(tiles))
    console.out.print(f"{out}")
