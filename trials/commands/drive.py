"""Closed-loop trials: what the errors of a localization cost a rover that must get somewhere."""

from pathlib import Path
from typing import Annotated

import typer

from trials.commands.datasets import Disturb, SceneName


def drive(
    scene: SceneName,
    localization: Annotated[
        str, typer.Option(help="Sources: truth, wheels, vo, another estimator, module:Class.")
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
        Path | None, typer.Option(help="JSON lines, one for each trial, written as they end.")
    ] = None,
) -> None:
    """Drive to goals in many worlds by each source of localization, and compare."""
    import json
    from dataclasses import asdict

    from rich.table import Table

    from trials.commands import console
    from trials.gym.policies import NavigatorPolicy
    from trials.gym.protocol import Trial, run_trials, summary
    from trials.gym.settings import NavSettings
    from vo.contract.settings import validated

    options = {
        "scene": scene,
        "rate_hz": 10.0,
        "disturb": disturb,
        "settings": _values(overrides or []),
        **_sorted_options(option or []),
        "observe": NavigatorPolicy.NEEDS,
    }
    validated(NavSettings, options)
    sources = [word.strip() for word in localization.split(",") if word.strip()]
    done: list[Trial] = []
    file = out.open("w", encoding="utf-8") if out else None
    try:
        with console.progress_bar("driving") as progress:
            total = worlds * runs * len(sources)
            for trial in run_trials(options, sources, range(seed, seed + worlds), runs):
                done.append(trial)
                progress(len(done), total)
                if file:
                    file.write(json.dumps(asdict(trial)) + "\n")
                    file.flush()
    finally:
        if file:
            file.close()
    columns = {source: summary([t for t in done if t.localization == source]) for source in sources}
    table = Table(f"{scene}, {worlds} worlds x {runs}", *sources)
    for name in columns[sources[0]]:
        table.add_row(name, *(column[name] for column in columns.values()))
    console.out.print(table)


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
    from trials.gym.settings import NavSettings

    values = _values(words)
    mine = {key: value for key, value in values.items() if key in NavSettings.model_fields}
    others = {key: value for key, value in values.items() if key not in mine}
    return {**mine, "scene_options": others}
