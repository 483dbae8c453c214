"""`driftyard preview`: pictures or a film of a scene before it is recorded."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scenes import SCENES
from sim.batch import build
from sim.camera_names import CAMERAS
from sim.preview.camera_sheet import camera_sheet, camera_view
from sim.preview.film import FILMS, make_film
from sim.preview.preview import PICTURES, overview, tile, write_picture
from sim.preview.preview import preview as write_sheet
from trials.cli import console
from trials.cli.options import RecordingOptions, argument, option
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix


def preview(
    recording: RecordingOptions,
    scene: str = argument(
        ...,
        "Scene as for `generate`, or `all` for one picture of every scene; with `--camera all` or "
        "`--camera A,B`, through several cameras.",
    ),
    out: Path | None = option(
        None, "PNG or JPEG of views, labels and map.", show_default="preview.png, unless --film"
    ),
    film: Path | None = option(None, "MP4 or GIF of the first seconds.", metavar="FILE"),
    seconds: float = option(8.0, "Length of the film, s.", min=0.2),
) -> None:
    """Render a contact sheet of views, labels and map, or a short film."""
    sheet = Path("preview.png") if out is None and film is None else out
    if sheet is not None:
        known_suffix(sheet, PICTURES)
    if film is not None:
        known_suffix(film, FILMS)
    if scene == "all":
        if film is not None or sheet is None:
            raise SettingsError("--film: shows one scene, not all")
        _preview_all(sheet, recording)
        return
    cameras = list(CAMERAS) if recording.camera == "all" else recording.camera.split(",")
    if len(cameras) > 1:
        if film is not None or sheet is None:
            raise SettingsError("--film: is of one camera, not of several")
        _preview_cameras(sheet, scene, recording, cameras)
        return
    settings = recording.settings(scene)
    built = build(scene, settings)
    if sheet is not None:
        write_sheet(built, settings, sheet)
        console.out.print(f"{sheet}")
    if film is not None:
        with console.progress_bar(f"filming {built.name}") as progress:
            make_film(built, settings, film, seconds, progress)
        console.out.print(f"{film}")


def _preview_cameras(
    out: Path, scene: str, recording: RecordingOptions, cameras: Sequence[str]
) -> None:
    """Picture one moment of a scene through several cameras."""
    views = {}
    with console.counting_bar("cameras", len(cameras)) as advance:
        for name in cameras:
            settings = replace(recording, camera=name).settings(scene)
            views[name] = camera_view(build(scene, settings), settings)
            advance(name)
    write_picture(out, camera_sheet(views))
    console.out.print(f"{out}")


def _preview_all(out: Path, recording: RecordingOptions) -> None:
    """Picture every registered scene with its own settings."""
    tiles = []
    with console.counting_bar("scenes", len(SCENES)) as advance:
        for name in SCENES:
            settings = recording.settings(name)
            tiles.append(tile(build(name, settings), settings))
            advance(name)
    write_picture(out, overview(tiles))
    console.out.print(f"{out}")
