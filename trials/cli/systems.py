"""`driftyard systems`: odometry systems of other authors, each in an environment of its own."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Distance, Disturb, Scenes, argument, changes, option
from trials.estimators.systems.environments import SYSTEMS, install, is_installed, package_of
from trials.report.tables import text_table
from trials.studies.systems.pages import write_comparison
from trials.studies.systems.study import EVERY, Plan, compare_systems


def systems_list() -> None:
    """List the systems, which are names for --estimator, and whether each is installed."""
    rows = [
        (name, x.about, x.license, "yes" if is_installed(name) else "no", x.needs or "nothing")
        for name, x in SYSTEMS.items()
    ]
    console.print_table(("system", "what it is", "license", "installed", "also requires"), rows)


def systems_install(
    systems: list[str] = argument(..., "Names, as of `systems list`.", metavar="SYSTEM..."),
) -> None:
    """Create a virtual environment for a system and install its packages with pip."""
    for system in systems:
        package_of(system)  # a wrong name is refused before the first is installed
    for system in systems:
        console.out.print(f"{system}: {install(system)}", markup=False)


@dataclass(frozen=True)
class DriveOptions:
    """Drives through scenes."""

    PANEL: ClassVar[str] = "Drives"
    scenes: Scenes = "all"
    seeds: int = option(3, "Number of drives in each scene.", min=1)
    distance: Distance = 10.0
    camera: Camera = DEFAULT_CAMERA
    disturb: Disturb = ""
    overrides: list[str] = changes("recording")


def systems_compare(
    drives: DriveOptions,
    estimator: list[str] = option(
        [],
        "Estimators a,b, or one with its settings; may be repeated.",
        metavar="'NAME KEY=VALUE ...'",
        show_default="driftyard, corner_flow and all systems",
    ),
    repeats: int = option(3, "Number of runs of estimators with seed or varying results.", min=1),
    add: list[str] = option(
        [],
        "Trajectory files SCENE-SEED.txt of a program that ran elsewhere; may be repeated.",
        metavar="NAME=FOLDER",
    ),
    jobs: int = option(1, "Number of runs at a time, each on a core of its own.", min=1),
    out: Path = option(Path("build/systems"), "Folder of the page."),
) -> None:
    """Compare systems over scenes; write a page as HTML, Markdown and JSON.

    The same command continues after an interruption; what failed is tried again.
    """
    plan = Plan(
        estimator or EVERY, drives.scenes, drives.seeds, repeats, drives.distance,
        drives.overrides, drives.disturb, drives.camera, add, jobs,
    )  # fmt: skip
    command = shlex.join(["driftyard", *sys.argv[1:]])
    found = compare_systems(plan, command, console.progress_bar)
    console.out.print(text_table(*found.summary(), "All scenes: median (95 % interval)"))
    for system, names, problem in found.failures:
        console.err.print(f"{system}, {names}: {problem}", markup=False)
    for file in write_comparison(found, out):
        console.out.print(f"{file}", markup=False)
