"""`driftyard route grid`: an urgent vehicle in the simulated traffic of a Manhattan grid."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from trials.cli import console
from trials.cli.options import option
from trials.cli.route_signals import EIGHT
from trials.cli.workers import WorkersOptions
from trials.report.figure import save_figure
from trials.report.tables import markdown_table
from trials.routing import grid_report
from trials.routing.city import City
from trials.routing.grid_study import GridSettings, run_study, shortest_s
from trials.routing.phases import read_phases
from trials.routing.sumo import require_sumo
from vo.contract.errors import SettingsError
from vo.contract.files import write_text

MAX_PER_HOUR = 3600
SIZE_IN = (13.0, 4.4)


@dataclass(frozen=True)
class CityOptions:
    """The city and the drive of the urgent vehicle."""

    PANEL: ClassVar[str] = "City"
    side: int = option(4, "Number of intersections in a row and in a column.", min=1, max=26)
    phases: str = option(EIGHT, "Phases of every signal in their order.", metavar="A+B,...")
    blocked: float = option(0.2, "Ratio of roads that are blocked during the drive.", min=0, max=1)
    blocked_lanes: int = option(1, "Number of their lanes that are blocked.", min=1, max=2)
    closed: str = option("", "Roads that do not exist, as A1-A2.", metavar="A,B,C")
    start: str | None = option(
        None, "Entry of the vehicle, as west1.", metavar="ENTRY", show_default="random, west"
    )
    goal: str | None = option(
        None, "Its goal, as east3.", metavar="ENTRY", show_default="random, east"
    )

    @property
    def settings(self) -> GridSettings:
        """The settings; raises if names, phases or the path between given ends are wrong."""
        if not 0 <= self.blocked <= 1:  # such as nan
            raise SettingsError(f"--blocked {self.blocked}: expected a number from 0 to 1")
        city = City(self.side, tuple(filter(None, self.closed.split(","))))
        phases = read_phases(self.phases)
        settings = GridSettings(
            city, phases, self.blocked, self.blocked_lanes, self.start, self.goal
        )
        shortest_s(city, self.start or "west1", self.goal or "east1")
        return settings


def route_grid(
    city: CityOptions,
    workers: WorkersOptions,
    out: Path = option(..., "Folder for figure, tables and verdict."),
    volumes: str = option(
        "200,400", "Vehicles that enter at every entry in an hour.", metavar="A,B,C"
    ),
    seeds: int = option(10, "Number of traffics at each volume.", min=1),
    seed: int = option(0, "First random seed of traffic, ends and blocked lanes.", min=0),
) -> None:
    """Simulate a vehicle that is routed statically or by D* Lite, with and without preemption.

    Needs Eclipse SUMO, the extra `traffic` of the package.
    """
    if out.exists() and not out.is_dir():
        raise SettingsError(f"{out}: is a file; --out names a folder")
    settings, per_hour = city.settings, _volumes(volumes)
    require_sumo()
    numbers = range(seed, seed + seeds)
    with console.counting_bar("traffics", len(per_hour) * seeds) as done:
        results = grid_report.Results(run_study(settings, per_hour, numbers, done))
    page: list[str] = []
    for volume in results.volumes:
        rows, title = grid_report.rows(results, volume), f"{volume:g} vehicles an hour"
        console.print_table(grid_report.HEADER, rows, title)
        page.append(f"{title}:\n\n{markdown_table(grid_report.HEADER, rows)}\n")
    verdict = grid_report.hypothesis(results)
    answer = "holds" if verdict.holds else "DOES NOT HOLD"
    console.out.print(f"{verdict.claim}: {answer} ({verdict.because})", markup=False)
    save_figure(out / "routing_grid.png", SIZE_IN, lambda figure: grid_report.draw(figure, results))
    grid_report.write_outcomes(out / "routing_grid.csv", results)
    write_text(out / "routing_grid.md", "\n".join(page))
    given = {**asdict(city), "volumes": per_hour, "seeds": seeds, "seed": seed}
    summary = {"settings": given, "verdict": asdict(verdict)}
    write_text(out / "routing_grid.json", json.dumps(summary, indent=1) + "\n")
    console.out.print(f"{out}", markup=False)


def _volumes(text: str) -> list[float]:
    try:
        volumes = sorted({float(x) for x in text.split(",")})
        if all(0 < x <= MAX_PER_HOUR for x in volumes):
            return volumes
    except ValueError:
        pass
    raise SettingsError(f"--volumes {text}: expected numbers above 0 up to {MAX_PER_HOUR}")
