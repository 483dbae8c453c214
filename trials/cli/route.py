"""`driftyard route`: static and dynamic routing of an urgent vehicle, with and without clearing.

With --rover, the rover drives the routes, and its times are compared with those of the model.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.random import Generator

from trials.cli import console
from trials.cli.options import option
from trials.cli.workers import WorkersOptions
from trials.evaluation.intervals import mean_interval
from trials.execution.cache import source_digest
from trials.execution.executor import compute
from trials.execution.tasks import Task
from trials.gym.env.settings import NavSettings
from trials.gym.studies.aisle_network import build_aisle_network
from trials.gym.studies.rover_routing import (
    SIZE_IN,
    RoverDrive,
    draw_drives,
    drive_layout,
    most_varied_layout,
)
from trials.navigation import PlanningError
from trials.report.figure import save_figure
from trials.report.tables import text_table, write_csv
from trials.routing import figures, study
from trials.routing.drive import STRATEGIES
from trials.routing.network import Network, large_network, read_map, small_network
from vo.contract.errors import SettingsError
from vo.contract.files import write_text
from vo.contract.settings import validated

SMALL = {"rig.width_px": 320, "rig.height_px": 240}


@dataclass(frozen=True)
class ModelOptions:
    """Drives in a model of a road network."""

    PANEL: ClassVar[str] = "Model"
    map_file: Path | None = option(
        None, "JSON file of a road network of your own.", "--map", metavar="FILE"
    )
    drives: int = option(300, "Number of random drives.", min=2)
    share: float = option(0.25, "Ratio of congested roads to all roads.", min=0.01, max=1)
    lead: float = option(30.0, "Time from a request until a node is clear, s.", min=0)


@dataclass(frozen=True)
class RoverOptions:
    """Drives of the rover through aisles."""

    PANEL: ClassVar[str] = "Rover, instead of the model"
    rover: str | None = option(
        None, "Scene with aisles to drive through: warehouse.", metavar="SCENE"
    )
    worlds: int = option(5, "Number of layouts of the scene.", min=1)
    localization: str = option("truth", "Source: truth, vo, an estimator, or module:Class.")


def route(
    model: ModelOptions,
    rover: RoverOptions,
    workers: WorkersOptions,
    out: Path = option(..., "Folder for figures, tables and verdicts."),
    seed: int = option(0, "Random seed of network and drives.", min=0),
) -> None:
    """Compute travel times over node delay, over queuing delay and at random, with verdicts.

    With --rover, the rover drives the computed routes, and its times are compared with the model.
    """
    if out.exists() and not out.is_dir():
        raise SettingsError(f"{out}: is a file; --out names a folder")
    if rover.rover is None:
        _route_model(out, model, seed)
        return
    if model.map_file is not None:
        raise SettingsError("--rover has its own map; leave --map out")
    _route_rover(rover.rover, out, rover.worlds, rover.localization, seed)


def _route_model(out: Path, model: ModelOptions, seed: int) -> None:
    rng = np.random.default_rng(seed)
    chosen: dict[str, tuple[Network, Sequence[study.Case]]] = {}
    if model.map_file is None:
        network, small = large_network(rng), small_network()
        chosen["one decision"] = small, [study.small_case(small)]
        name = "many routes"
    else:
        network, name = read_map(model.map_file), model.map_file.stem
    cases = _cases(network, model, rng)
    chosen[name] = network, cases[: max(2, model.drives // 3)]
    total = 2 * study.STEPS * sum(len(some) for _, some in chosen.values()) + 2 * model.drives
    with console.counting_bar("drives", total) as done:
        studies = {
            label: study.study(net, some, model.lead, done) for label, (net, some) in chosen.items()
        }
        during = study.randomised(network, cases, model.lead, rng, done)
        before = study.randomised(network, cases, model.lead, rng, done, known_s=0.0)
    sweeps = [sweep for x in studies.values() for sweep in (x.node, x.queue)]
    found = [
        study.equal_without_congestion(studies),
        study.flat(studies),
        study.clearing_saves_more(during, studies[name].node),
        study.both_never_worse(during, before, sweeps),
    ]
    _draw(out, studies, during, rng)
    settings = {"drives": model.drives, "share": model.share, "lead_s": model.lead, "seed": seed}
    increase = {
        strategy.name: dict(zip(("mean", "low", "high"), astuple(mean_interval(x)), strict=True))
        for strategy, x in zip(STRATEGIES, during.increase_percent, strict=True)
    }
    summary = {
        "settings": {**settings, "map": model.map_file and str(model.map_file)},
        "increase_percent": increase,
        "verdicts": [asdict(verdict) for verdict in found],
    }
    write_text(out / "routing.json", json.dumps(summary, indent=1, allow_nan=False) + "\n")
    for verdict in found:
        answer = "holds" if verdict.holds else "DOES NOT HOLD"
        console.out.print(f"{verdict.claim}: {answer} ({verdict.because})", markup=False)
    console.out.print(f"{out}", markup=False)


def _cases(network: Network, model: ModelOptions, rng: Generator) -> list[study.Case]:
    try:
        return [study.random_case(network, model.share, rng) for _ in range(model.drives)]
    except PlanningError as error:
        raise PlanningError(f"{model.map_file}: {error}") from None


def _draw(
    out: Path, studies: dict[str, study.Study], during: study.Randomised, rng: Generator
) -> None:
    """Write the figures and the data that they show."""
    count, name = len(studies), [*studies][-1]
    for stem, size_in, fill in (
        ("networks", (4.6 * count + 0.6, 5.2), lambda f: figures.draw_networks(f, studies)),
        ("delays", (9.0, 3.4 * count + 0.5), lambda f: figures.draw_delays(f, studies)),
        ("random", (7.2, 4.2), lambda f: figures.draw_random(f, during, name, rng)),
    ):
        save_figure(out / f"routing_{stem}.png", size_in, fill)
    figures.write_delays(out / "routing_delays.csv", studies)
    figures.write_random(out / "routing_random.csv", during)


def _route_rover(scene: str, out: Path, worlds: int, localization: str, seed: int) -> None:
    """Drive the rover through aisles and doors of several worlds, with every strategy."""
    options: dict[str, object] = {
        "scene": scene,
        "scene_options": {"stock": 1.0} if scene == "warehouse" else {},
        "observe": ("pose",),
        "localization": localization,
        "settings": SMALL if localization == "truth" else {},
        "rate_hz": 10.0,
        "time_limit_s": 300.0,
        "distance_m": (1.0, 100.0),
    }
    trial = validated(NavSettings, options)
    layouts = range(seed, seed + worlds)
    causes = (source_digest((), localization.partition(":")[0]) if ":" in localization else "",)
    tasks = [
        Task("trial", f"world {x}", drive_layout, (options, x), list[RoverDrive], causes)
        for x in layouts
    ]
    with console.counting_bar("worlds", worlds) as count:
        drives = [drive for of_world in compute(tasks, count) for drive in of_world]
    _print_drives(f"{scene}, {worlds} worlds, localized by {localization}", drives)
    shown = most_varied_layout(drives)
    instance = trial.build(shown)
    aisles = build_aisle_network(instance, trial.speed_max_mps)
    space = instance.traversable.space
    save_figure(
        out / "rover_routes.png",
        SIZE_IN,
        lambda figure: draw_drives(figure, drives, shown, aisles, space),
    )
    header = ("layout", "strategy", "outcome", "undelayed_s", "predicted_s", "measured_s", "nodes")
    rows = [
        (d.layout, d.strategy, d.outcome, f"{d.free_s:.2f}", f"{d.predicted_s:.2f}",
         f"{d.measured_s:.2f}", " > ".join(d.passed))
        for d in drives
    ]  # fmt: skip
    write_csv(out / "rover_routes.csv", header, rows)
    console.out.print(f"{out}", markup=False)


def _print_drives(title: str, drives: Sequence[RoverDrive]) -> None:
    rows: list[tuple[str, ...]] = []
    for strategy in STRATEGIES:
        mine = [d for d in drives if d.strategy == strategy.name]
        predicted_s, measured_s, ratio = (
            mean_interval(np.array(values))
            for values in (
                [d.predicted_s for d in mine],
                [d.measured_s for d in mine],
                [d.measured_s / d.predicted_s for d in mine],
            )
        )
        arrived = sum(d.outcome == "success" for d in mine)
        same = sum(d.predicted == d.passed for d in mine)
        times = (predicted_s.text(1), measured_s.text(1), ratio.text(2))
        rows.append((strategy.name, f"{arrived}/{len(mine)}", *times, f"{same}/{len(mine)}"))
    header = (title, "arrived", "model, s", "rover, s", "rover over model", "as the model went")
    console.out.print(text_table(header, rows))
