"""`driftyard trial-film`: one trial with each source of localization, as an animation."""

from pathlib import Path

from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.studies.showcase import film_sources
from vo.contract.files import known_suffix


def trial_film(
    out: Path = argument(..., "Animation to write, .webp."),
    scene: str = option("office", "Registered scene, MJCF file or module:function."),
    layout: int = option(0, "Random seed of the world.", min=0),
    seed: int = option(0, "Random seed of start, goal and noise.", min=0),
    sources: str = option("wheels,vo", "Sources of localization, as for `drive`.", metavar="A,B,C"),
    seconds: float = option(45.0, "Time limit of the trial, s.", min=1),
) -> None:
    """Film a trial on slippery ground with each source of localization, one above the other."""
    known_suffix(out, (".webp",))
    film_sources(out, scene, layout, seed, [x.strip() for x in sources.split(",")], seconds)
    console.out.print(f"{out}")
