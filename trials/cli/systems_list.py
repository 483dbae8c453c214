"""`driftyard systems list`: odometry systems of other authors."""

from trials.cli import console
from trials.estimators.systems.environments import SYSTEMS, folder_of


def systems_list() -> None:
    """List the systems with license, requirements and whether each is installed."""
    rows = [
        (name, x.license, "yes" if folder_of(name).is_dir() else "no", x.needs)
        for name, x in SYSTEMS.items()
    ]
    console.print_table(("system", "license", "installed", "also requires"), rows)
