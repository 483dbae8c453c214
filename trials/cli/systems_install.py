"""`driftyard systems install`: a system of other authors in an environment of its own."""

from trials.cli import console
from trials.cli.options import argument
from trials.estimators.systems.environments import install


def systems_install(
    systems: list[str] = argument(..., "Names, as of `systems list`.", metavar="SYSTEM..."),
) -> None:
    """Create a virtual environment for a system and install its packages with pip."""
    for system in systems:
        console.out.print(f"{system}: {install(system)}", markup=False)
