"""`driftyard scenes`: the registered scenes, disturbances and cameras."""

from scenes import SCENES
from sim.camera_names import CAMERAS
from sim.disturbances import DISTURBANCES
from trials.cli import console


def scenes() -> None:
    """List the scenes with what each tests, the disturbances with their effect, and the cameras."""
    console.print_table(("scene", "tests"), [(x, builder.tests) for x, builder in SCENES.items()])
    console.out.print()
    rows = [(name, disturbance.about) for name, disturbance in DISTURBANCES.items()]
    console.print_table(("disturbance", "at strength 1"), rows)
    console.out.print()
    console.print_table(("camera", "what it is"), CAMERAS.items())
