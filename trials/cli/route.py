"""Static against dynamic routing of an urgent vehicle, with and without clearing: route."""

import json
from dataclasses import asdict, astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from numpy.random import Generator

    from trials.routing.network import Network
    from trials.routing.study import Case, Randomised, Study
    from trials.routing.verdicts import Verdict


def route(
    out: Annotated[Path, typer.Option(help="Folder for figures, tables and verdicts.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="One's own network, JSON.")
    ] = None,
    drives: Annotated[int, typer.Option(min=2, help="Random drives.")] = 300,
    share: Annotated[
        float, typer.Option(min=0.01, max=1, help="Of the roads that become congested.")
    ] = 0.25,
    lead: Annotated[
        float, typer.Option(min=0, help="Seconds from a request until a node is clear.")
    ] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    rover: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE", help="Drive the rover through its aisles instead: warehouse."
        ),
    ] = None,
    worlds: Annotated[int, typer.Option(min=1, help="With --rover: layouts of the scene.")] = 5,
    localization: Annotated[
        str, typer.Option(help="With --rover: truth, vo, another source, module:Class.")
    ] = "truth",
) -> None:
    """Draw travel times over node delay, over queuing delay and at random, and judge them.

    With --rover, drive what was routed, and compare with the model.
    """
    import numpy as np

    from trials.cli import console
    from trials.routing.generation import large_network, small_network
    from trials.routing.maps import read_map
    from trials.routing.study import STEPS, randomised, small_case, study
    from vo.contract.errors import SettingsError

    if out.exists() and not out.is_dir():
        raise SettingsError(f"{out}: is a file; --out names a folder")
    if rover is not None:
        if map_file is not None:
            raise SettingsError("--rover has its own map; leave --map out")
        from trials.cli.route_rover import route_rover

        route_rover(rover, out, worlds, localization, seed)
        return
    rng = np.random.default_rng(seed)
    if map_file is None:
        network, small = large_network(rng), small_network()
        chosen = {"one decision": (small, [small_case(small)])}
        name = "many routes"
    else:
        network, chosen, name = read_map(map_file), {}, map_file.stem
    cases = _cases(network, share, drives, rng, map_file)
    chosen[name] = network, cases[: max(2, drives // 3)]
    total = 2 * STEPS * sum(len(some) for _, some in chosen.values()) + 2 * drives
    with console.counting_bar("drives", total) as done:
        studies = {label: study(*part, lead, done) for label, part in chosen.items()}
        during = randomised(network, cases, lead, rng, done)
        before = randomised(network, cases, lead, rng, done, known_s=0.0)
    verdicts = judge(studies, during, before)
    draw(out, studies, during, rng)
    settings = {"drives": drives, "share": share, "lead_s": lead, "seed": seed}
    write_summary(out, {**settings, "map": map_file and str(map_file)}, during, verdicts)
    for verdict in verdicts:
        answer = "holds" if verdict.holds else "DOES NOT HOLD"
        console.out.print(f"{verdict.claim}: {answer} ({verdict.because})", markup=False)
    console.out.print(f"{out}", markup=False)


def _cases(
    network: "Network", share: float, drives: int, rng: "Generator", map_file: Path | None
) -> "list[Case]":
    from trials.navigation.errors import PlanningError
    from trials.routing.study import random_case

    try:
        return [random_case(network, share, rng) for _ in range(drives)]
    except PlanningError as error:
        raise PlanningError(f"{map_file}: {error}") from None


def judge(
    studies: "dict[str, Study]", during: "Randomised", before: "Randomised"
) -> "list[Verdict]":
    """Hold what was expected against the figures; the last study is that of the random drives."""
    from trials.routing import verdicts

    sweeps = [sweep for x in studies.values() for sweep in (x.node, x.queue)]
    return [
        verdicts.equal_without_congestion(studies),
        verdicts.flat(studies),
        verdicts.clearing_saves_more(during, [*studies.values()][-1].node),
        verdicts.both_never_worse(during, before, sweeps),
    ]


def draw(out: Path, studies: "dict[str, Study]", during: "Randomised", rng: "Generator") -> None:
    """Write the figures and the data that they show."""
    from trials.routing import figures, tables
    from vo.contract.files import replacing, write_text

    drawn = {
        "networks": figures.draw_networks(studies),
        "delays": figures.draw_delays(studies),
        "random": figures.draw_random(during, [*studies][-1], rng),
    }
    for stem, figure in drawn.items():
        with replacing(out / f"routing_{stem}.png") as partial:
            figure.savefig(partial, format="png")
    write_text(out / "routing_delays.csv", tables.delays_csv(studies))
    write_text(out / "routing_random.csv", tables.random_csv(during))


def write_summary(
    out: Path,
    settings: dict[str, object],
    during: "Randomised",
    verdicts: "list[Verdict]",
) -> None:
    """Write settings, mean increases with their intervals, and verdicts."""
    from trials.evaluation.intervals import mean_interval
    from trials.routing.drive import STRATEGIES
    from vo.contract.files import write_text

    increase = {
        strategy.name: dict(zip(("mean", "low", "high"), astuple(mean_interval(x)), strict=True))
        for strategy, x in zip(STRATEGIES, during.increase_percent, strict=True)
    }
    summary = {
        "settings": settings,
        "increase_percent": increase,
        "verdicts": [asdict(verdict) for verdict in verdicts],
    }
    write_text(out / "routing.json", json.dumps(summary, indent=1, allow_nan=False) + "\n")
