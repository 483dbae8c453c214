"""Commands of `driftyard`: in which panel each stands, what it does, and an example.

A command is a function of its own name in a module named after its first word, or after all its
words where the first is a command as well. The module is imported when the command is used; the
command line starts fast although its commands import all of the project.
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
        "degrade": ("Disturb a real recording.", "kitti_06 --disturb noise=0.5 --out noisy"),
        "label": ("Write tracks, boxes and geometry.", "court --out court_labels --pictures"),
        "index": ("List, index and verify many datasets.", "many --scene office --verify"),
        "fetch": ("Download datasets by scene, seed and label.", "s3://bucket/many --out few"),
        "verify": ("Verify the hashes and the certificate of a dataset.", "court"),
    },
    "Estimators": {
        "run": ("Run an estimator.", "court --out court.txt --estimator corner_flow"),
        "calibrate": ("Estimate errors of a stereo calibration.", "court --picture rows.png"),
        "score": ("Compare trajectories with the ground truth.", "court court.txt --json"),
        "view": ("Show a dataset and runs in Rerun's viewer.", "court court.txt"),
        "compare": ("Compare a simulated recording with a real one.", "kitti_06 court"),
        "match": ("Find the camera settings of a real recording.", "kitti_06 --out camera.toml"),
        "report": ("Write an HTML report of runs.", "court court.txt --out court.html"),
        "explain": ("Attribute drift to stages.", "--scene brick_court --seeds 3"),
        "gate": ("Compare with a stored baseline.", "check --baseline gate.json"),
        "gate check": ("Decide whether an estimator has regressed.", "--baseline gate.json"),
        "gate update": ("Write a baseline.", "--baseline gate.json --scenes all --seeds 2"),
        "gate history": ("Show the checks of a gate over its commits.", "gate.jsonl --last 50"),
        "gate plan": ("Compute how many sequences find a change.", "5% --baseline gate.json"),
        "gate power": ("Simulate false alarm rate and power.", "--repetitions 1000"),
    },
    "Navigation": {
        "drive": ("Compare sources of localization.", "office --localization truth,vo --worlds 10"),
        "route": ("Compare static with dynamic routing of a vehicle.", "--out routing"),
        "route signals": ("List the phases that an urgent vehicle needs.", "--present 3+8"),
        "route timing": ("Compute when a signal's preemption begins.", "--arrival 60 --queue 8"),
        "route grid": ("Route a vehicle through traffic in SUMO.", "--out grid --seeds 4"),
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
        "doctor": ("Check OpenGL drivers and packages.", "--devices"),
    },
}
"""Panel to the commands in it, each with its summary and the words of an example."""

COMMANDS = {
    name: Entry(panel, summary, f"driftyard {name} {words}".rstrip())
    for panel, named in PANELS.items()
    for name, (summary, words) in named.items()
}
"""Every command by its words."""

GROUPS = ("gate", "systems")
"""Names that stand for the commands that begin with them, and do nothing themselves."""


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
        if rest and (both := f"{name} {rest[0]}") in COMMANDS and name not in GROUPS:
            return both, load(both), rest[1:]
        if name in self.entries:
            command = load(self.prefix + name)
        return name, command, rest


def load(name: str) -> Any:
    """Import a command by its words, or make the group of that name."""
    entry = COMMANDS[name]
    example = f"Example: {entry.example}"
    if name in GROUPS:
        return LazyGroup(
            name=name, prefix=f"{name} ", help=entry.summary, epilog=example, no_args_is_help=True
        )
    first, _, last = name.partition(" ")
    function = name.replace("-", "_").replace(" ", "_")
    module = function if last and first not in GROUPS else first.replace("-", "_")
    command = getattr(importlib.import_module(f"trials.cli.{module}"), function)
    others = [x for x in COMMANDS if x.startswith(f"{name} ")]
    if others:
        example += f"\n\nSee also: {', '.join(f'driftyard {x}' for x in others)}"
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(last or name, epilog=example)(expand(command))
    return typer.main.get_command(app)
