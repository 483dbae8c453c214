"""Commands of `driftyard`: in which panel each stands, what it does, and an example.

A command is a function of its own name in a module named after its first word, which is imported
when the command is used; the command line starts fast although its commands import all of the
project.
"""

import importlib
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from trials.cli.options import expand


@dataclass(frozen=True)
class Entry:
    """One command or group: heading and line in the list of commands, and example in the help."""

    panel: str
    summary: str
    example: str


PANELS: dict[str, dict[str, tuple[str, str]]] = {
    "Datasets": {
        "scenes": ("List scenes and disturbances.", ""),
        "preview": ("Render pictures of a scene.", "brick_court --out preview.png"),
        "generate": ("Record datasets.", "brick_court --out court --set drive.distance_m=20"),
        "export": ("Write datasets in other formats.", "court --to kitti --out court_kitti"),
        "label": ("Write tracks, boxes and geometry.", "court --out court_labels --pictures"),
        "verify": ("Verify the hashes and the certificate of a dataset.", "court"),
    },
    "Estimators": {
        "run": ("Run an estimator.", "court --out court.txt --estimator corner_flow"),
        "score": ("Compare trajectories with the ground truth.", "court court.txt --json"),
        "view": ("Show a dataset and runs in Rerun's viewer.", "court court.txt"),
        "report": ("Write an HTML report of runs.", "court court.txt --out court.html"),
        "explain": ("Attribute drift to stages.", "--scene brick_court --seeds 3"),
        "gate": ("Compare with a stored baseline.", "check --baseline gate.json"),
        "gate check": ("Decide whether an estimator has regressed.", "--baseline gate.json"),
        "gate update": ("Write a baseline.", "--baseline gate.json --scenes all --seeds 2"),
        "gate plan": ("Compute how many sequences find a change.", "5% --baseline gate.json"),
        "gate power": ("Simulate false alarm rate and power.", "--repetitions 1000"),
    },
    "Navigation": {
        "drive": ("Compare sources of localization.", "office --localization truth,vo --worlds 10"),
        "route": ("Compare static with dynamic routing of a vehicle.", "--out routing"),
    },
    "Studies and measurements": {
        "accuracy": ("Measure the drift of the default settings.", "--scenes office --seeds 2"),
        "benchmark": ("Run estimators over a published data set.", "euroc EuRoC --seeds 5"),
        "stress": ("Raise a disturbance until an estimator fails.", "noise --seeds 2"),
        "response": ("Measure the drift of every disturbance and scene.", "--only blur,office"),
        "experiment": ("Test claims of the thesis.", "E1,E3"),
        "label-accuracy": ("Verify labels, blur and sensors.", "--scenes brick_court"),
        "point-world": ("Compare with the Cramér-Rao bound on noisy points.", "--worlds 50"),
        "bump": ("Draw a brick under a wheel in every channel.", "--scene office --out bump.png"),
        "bench": ("Measure the speed of generator, estimators and start.", "--quick"),
        "replanning": ("Compare the time of D* Lite with that of A*.", "--changes 50"),
        "trial-speed": ("Measure the speed of a navigation environment.", "warehouse"),
        "trial-memory": ("Measure memory over many resets.", "turntable --resets 1000"),
        "trial-film": ("Film a navigation trial.", "trial.webp --scene office --layout 3"),
    },
    "Help and installation": {
        "demo": ("Generate, estimate, score and report one drive.", ""),
        "settings": ("List settings with unit, default and range.", "estimator matching"),
        "systems": ("Install and compare systems of other authors.", "install orbslam3"),
        "systems list": ("List the systems.", ""),
        "systems install": ("Install a system into an environment of its own.", "orbslam3"),
        "systems compare": ("Compare systems over scenes.", "--scenes office,dusk --seeds 2"),
        "doctor": ("Check OpenGL drivers and packages.", ""),
    },
}
"""Panel to the commands in it, each with its summary and the words of an example."""

COMMANDS = {
    name: Entry(panel, summary, f"driftyard {name} {words}".rstrip())
    for panel, named in PANELS.items()
    for name, (summary, words) in named.items()
}
"""Every command by its words."""


class LazyGroup(TyperGroup):
    """Group whose commands are imported when they are used."""

    def __init__(self, *, prefix: str = "", **words: Any) -> None:
        """Make the group of the commands that begin with a prefix, which ends with a space."""
        super().__init__(**words)
        self.prefix = prefix
        self.entries = {
            name.removeprefix(prefix): entry
            for name, entry in COMMANDS.items()
            if name.startswith(prefix) and " " not in name.removeprefix(prefix)
        }
        self.commands = {
            name: TyperCommand(
                name, help=entry.summary, rich_help_panel=None if prefix else entry.panel
            )
            for name, entry in self.entries.items()
        }

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Import the command that the arguments name."""
        name, command, rest = super().resolve_command(ctx, args)
        if name in self.entries:
            command = load(self.prefix + name)
        return name, command, rest


def load(name: str) -> Any:
    """Import a command by its words, or make the group of that name."""
    entry = COMMANDS[name]
    example = f"Example: {entry.example}"
    if any(x.startswith(f"{name} ") for x in COMMANDS):
        return LazyGroup(
            name=name, prefix=f"{name} ", help=entry.summary, epilog=example, no_args_is_help=True
        )
    module, _, _ = (name := name.replace("-", "_")).partition(" ")
    function = getattr(importlib.import_module(f"trials.cli.{module}"), name.replace(" ", "_"))
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(name.rpartition(" ")[2], epilog=example)(expand(function))
    return typer.main.get_command(app)
