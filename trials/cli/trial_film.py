"""`driftyard trial-film`: one trial with each source of localization, as an animation."""

from pathlib import Path
from typing import Annotated

import typer

from sim.preview.image_file import known_suffix
from trials.cli import console
from trials.gym.media.showcase import film_sources


def trial_film(
    out: Annotated[Path, typer.Argument(help="Animation to write, .webp.")],
    scene: Annotated[
        str, typer.Option(help="Registered scene, MJCF file or module:function.")
    ] = "office",
    layout: Annotated[int, typer.Option(min=0, help="Random seed of the world.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of start, goal and noise.")] = 0,
    sources: Annotated[
        str, typer.Option(metavar="A,B,C", help="Sources of localization, as for `drive`.")
    ] = "wheels,vo",
    seconds: Annotated[float, typer.Option(min=1, help="Time limit of the trial, s.")] = 45.0,
) -> None:
    """Film a trial on slippery ground with each source of localization, one above the other."""
    known_suffix(out, (".webp",))
    film_sources(out, scene, layout, seed, [x.strip() for x in sources.split(",")], seconds)
    console.out.print(f"{out}")
