"""Looking at a scene before it is recorded: preview."""

from pathlib import Path
from typing import Annotated

import typer

from trials.commands.datasets import Config, Disturb, Overrides, SceneName, Seed, record_settings


def preview(
    scene: SceneName,
    out: Annotated[Path, typer.Option(help="PNG to write.")] = Path("preview.png"),
    seed: Seed = None,
    overrides: Overrides = None,
    config: Config = None,
    disturb: Disturb = "",
) -> None:
    """Render a contact sheet of what the rover will see, and the map from above, as one PNG."""
    from sim.batch import build
    from sim.preview import preview as render_sheet
    from trials.commands import console

    settings = record_settings(scene, seed, overrides or [], config, disturb)
    render_sheet(build(scene, settings), settings, out)
    console.out.print(f"{out}")
