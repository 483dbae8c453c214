"""`driftyard systems install`: a system of other authors in an environment of its own."""

from typing import Annotated

import typer

from trials.cli import console
from trials.estimators.systems.environments import install


def systems_install(
    systems: Annotated[
        list[str], typer.Argument(metavar="SYSTEM...", help="Names, as of `systems list`.")
    ],
) -> None:
    """Create a virtual environment for a system and install its packages with pip."""
    for system in systems:
        console.out.print(f"{system}: {install(system)}", markup=False)
