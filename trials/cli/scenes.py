"""`driftyard scenes`: the registered scenes and disturbances."""

from scenes import SCENES
from sim.disturbances import DISTURBANCES
from trials.cli import console


def scenes() -> None:
    """List the scenes with what each tests, and the disturbances with their effect."""
    console.print_table(("scene", "tests"), [(x, builder.tests) for x, builder in SCENES.items()])
    console.out.print()
    rows = [(name, disturbance.about) for name, disturbance in DISTURBANCES.items()]
    console.print_table(("disturbance", "at strength 1"), rows)
