"""Closed-loop trials: what the errors of a localization cost a rover that must get somewhere."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.cli.datasets import Disturb, SceneName

if TYPE_CHECKING:
    from rich.table import Table

    from trials.gym.studies.trial_protocol import Trial


def drive(
    scene: SceneName,
    localization: Annotated[
        str,
        typer.Option(
            help="Sources: truth, drift:PERCENT, wheels, vo, another estimator, module:Class."
        ),
    ] = "truth,wheels,vo",
    worlds: Annotated[int, typer.Option(min=1, help="Layouts of the scene.")] = 10,
    runs: Annotated[int, typer.Option(min=1, help="Starts and goals in each.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of the first layout.")] = 0,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Of the scene or the trial; may be repeated."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Recording setting; may be repeated."),
    ] = None,
    disturb: Disturb = "",
    out: Annotated[
        Path | None,
        typer.Option(help="JSON lines, one for each trial. An interrupted study goes on."),
    ] = None,
    keep: Annotated[
        Path | None, typer.Option(help="Folder for a film and a dataset of every trial.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="PNG: success and collisions over drift.")
    ] = None,
    planning: Annotated[
        str | None, typer.Option(help="With a floor plan: static, dynamic, or static,dynamic.")
    ] = None,
    ideal_depth: Annotated[
        bool, typer.Option("--ideal-depth", help="With --planning: depth by rays, not by cameras.")
    ] = False,
) -> None:
    """Drive to goals in many worlds by each source of localization, and compare.

    Sources such as drift:5,drift:20,drift:80 inject that drift, for a curve of sensitivity. With
    --planning, ways of planning are compared, as in worlds with --option dynamics=blocked_aisles.
    """
    from itertools import chain

    from trials.cli import console
    from trials.gym.env.policies import NavigatorPolicy
    from trials.gym.env.settings import NavSettings
    from trials.gym.studies.fleet import run_trials
    from trials.gym.studies.result_store import Ledger
    from trials.report.figure import save_figure
    from vo.contract.errors import SettingsError
    from vo.contract.settings import validated

    options = {
        "scene": scene,
        "rate_hz": 10.0,
        "disturb": disturb,
        "settings": _values(overrides or []),
        **_sorted_options(option or []),
        "observe": NavigatorPolicy.NEEDS,
    }
    sources = [word.strip() for word in localization.split(",") if word.strip()]
    if not sources:
        raise SettingsError("--localization: names no source")
    for source in sources:
        validated(NavSettings, {**options, "localization": source})
    trial = validated(NavSettings, options)
    trial.recorded(seed)  # what is refused is refused now, not by the first worker
    title = f"{scene}, {worlds} worlds x {runs}"
    if planning is not None:
        from trials.cli.drive_planned import drive_planned
        from trials.gym.studies.planning import parse_planning

        if keep or figure:
            raise SettingsError("--planning goes with neither --keep nor --figure")
        plannings, layouts = parse_planning(planning), range(seed, seed + worlds)
        drive_planned(title, options, sources, plannings, layouts, runs, out, ideal_depth)
        return
    what = {"sources": sources, "runs": runs, "seed": seed, "worlds": worlds}
    study = json.dumps({"options": trial.model_dump(mode="json"), **what})
    ledger = Ledger(out, study) if out else None
    done = dict(ledger.done) if ledger else {}
    missing = [k for k in range(seed, seed + worlds) if k not in done]
    with console.counting_bar("worlds", len(missing)) as count:
        for of_world in run_trials(options, sources, missing, runs, keep):
            done[of_world[0].layout] = of_world
            if ledger:
                ledger.add(of_world)
            count(of_world)
    if ledger:
        ledger.close()
    every = list(chain.from_iterable(done[k] for k in sorted(done)))
    by_source = {x: [t for t in every if t.localization == x] for x in sources}
    console.out.print(_table(title, by_source))
    if figure:
        from trials.gym.studies.sensitivity import draw_sensitivity

        save_figure(figure, (8.0, 3.4), lambda empty: draw_sensitivity(empty, by_source))


def _table(title: str, by_source: Mapping[str, "list[Trial]"]) -> "Table":
    """Lay out one column a source."""
    from rich.table import Table

    from trials.gym.studies.trial_protocol import MEASURES, summary

    columns = {source: summary(of_source, MEASURES) for source, of_source in by_source.items()}
    table = Table(title, *columns)
    for name in next(iter(columns.values())):
        table.add_row(name, *(column[name] for column in columns.values()))
    return table


def _values(words: list[str]) -> dict[str, object]:
    """Read `key=value` as TOML reads values; what it cannot read is a string.

    Raises:
        SettingsError: If there is no `=`.
    """
    import tomllib

    from vo.contract.errors import SettingsError

    values: dict[str, object] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals:
            raise SettingsError(f"{word}: expected key=value")
        try:
            values[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = text.strip()
    return values


def _sorted_options(words: list[str]) -> dict[str, object]:
    """Options of the trial by name, and all others as `scene_options`."""
    from trials.gym.env.settings import NavSettings

    values = _values(words)
    mine = {key: value for key, value in values.items() if key in NavSettings.model_fields}
    others = {key: value for key, value in values.items() if key not in mine}
    return {**mine, "scene_options": others}
