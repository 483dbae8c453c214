"""`driftyard systems`: odometry systems of other authors, each in an environment of its own."""

from trials.cli import console
from trials.cli.options import argument
from trials.estimators.systems.environments import SYSTEMS, folder_of, install


def systems_list() -> None:
    """List the systems with license, requirements and whether each is installed."""
    rows = [
        (name, x.license, "yes" if folder_of(name).is_dir() else "no", x.needs)
        for name, x in SYSTEMS.items()
    ]
    console.print_table(("system", "license", "installed", "also requires"), rows)


def systems_install(
    systems: list[str] = argument(..., "Names, as of `systems list`.", metavar="SYSTEM..."),
) -> None:
    """Create a virtual environment for a system and install its packages with pip."""
    for system in systems:
        console.out.print(f"{system}: {install(system)}", markup=False)
