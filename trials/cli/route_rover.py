"""Drives of the rover on routes, compared with the routing model; for `driftyard route --rover`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trials.cli import console
from trials.evaluation.intervals import mean_interval
from trials.execution.parallel import map_parallel
from trials.gym.env.settings import NavSettings
from trials.gym.studies.aisle_network import build_aisle_network
from trials.gym.studies.rover_routing import RoverDrive, drive_layout
from trials.gym.studies.rover_routing_figure import SIZE_IN, draw_drives, most_varied_layout
from trials.report.figure import save_figure
from trials.report.tables import text_table, write_csv
from trials.routing.drive import STRATEGIES
from vo.contract.settings import validated

SMALL = {"rig.width_px": 320, "rig.height_px": 240}
TIME_LIMIT_S = 300.0


def route_rover(scene: str, out: Path, worlds: int, localization: str, seed: int) -> None:
    """Drive the rover through aisles and doors of several worlds, with every strategy.

    Raises:
        SettingsError: If the scene has no aisles, or the localization is unknown.
    """
    options: dict[str, object] = {
        "scene": scene,
        "scene_options": {"stock": 1.0} if scene == "warehouse" else {},
        "observe": ("pose",),
        "localization": localization,
        "settings": SMALL if localization == "truth" else {},
        "rate_hz": 10.0,
        "time_limit_s": TIME_LIMIT_S,
        "distance_m": (1.0, 100.0),
    }
    trial = validated(NavSettings, options)
    layouts = range(seed, seed + worlds)
    drives: list[RoverDrive] = []
    with console.counting_bar("worlds", worlds) as count:
        for _, of_world in map_parallel(drive_layout, [(options, layout) for layout in layouts]):
            drives += of_world
            count(of_world)
    drives.sort(key=lambda drive: drive.layout)
    _print_table(f"{scene}, {worlds} worlds, localized by {localization}", drives)
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


def _print_table(title: str, drives: Sequence[RoverDrive]) -> None:
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
