"""`driftyard label-accuracy`: labels, blur and sensors against independent computations."""

from trials.cli import console
from trials.cli.options import Scenes, Seed
from trials.cli.workers import WorkersOptions
from trials.execution.recording_settings import parse_scenes
from trials.studies.label_accuracy import measure_labels


def label_accuracy(
    workers: WorkersOptions, seed: Seed = 0, scenes: Scenes = "brick_court,office"
) -> None:
    """Measure how exact labels, blur and sensors are, and print it beside the promised accuracy.

    Depth is compared with ray casts, outlines with projected corners, labels with pixels under
    noise, adaptive blur with many sub-frames, inertial readings and wheels with the path.
    """
    rows = measure_labels(parse_scenes(scenes), seed, console.progress_bar)
    cells = [(*x[:-1], "yes" if x[-1] else "[bold red]no[/]") for x in rows]
    console.print_table(("measured", "on", "found", "promised", "holds"), cells)
