"""Guarding an estimator: gate."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trials.cli.datasets import Config, Disturb, Overrides
from trials.cli.runs import Choice, Label, Program, Timeout

if TYPE_CHECKING:
    from trials.estimators.choice import Named
    from trials.estimators.plugins.command import Command
    from trials.gate.baseline import Baseline
    from trials.gate.comparison import Comparison

EXIT = {"pass": 0, "regress": 1, "undecided": 3}
"""Statuses; 2 is bad input, as everywhere."""
BLESS = (
    *("scenes", "seeds", "first_seed", "distance", "disturb", "record", "reference"),
    *("level", "tolerance", "margin", "time_margin", "nees_margin"),
)
COMPARE = ("accept", "plan", "json_file", "markdown", "junit")
"""Options that only one of the two uses."""


def gate(
    ctx: typer.Context,
    baseline: Annotated[Path, typer.Option(help="JSON file of the baseline.")],
    estimator: Choice = None,
    command: Program = None,
    timeout: Timeout = 3600.0,
    label: Label = "",
    overrides: Overrides = None,
    config: Config = None,
    cache: Annotated[Path, typer.Option(help="Folder of recordings.")] = Path("build/cache"),
    accept: Annotated[
        str, typer.Option(help="What may differ from the baseline: datasets, platform, or both.")
    ] = "",
    plan: Annotated[
        str, typer.Option(metavar="PERCENT", help="Also say what it takes to find such a change.")
    ] = "",
    json_file: Annotated[Path | None, typer.Option("--json", help="Write all figures.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write a pull-request comment.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML.")] = None,
    bless: Annotated[
        bool, typer.Option("--bless", help="Write a baseline; takes the options below.")
    ] = False,
    scenes: Annotated[str, typer.Option(help="Names, a,b,c, or all.")] = "",
    seeds: Annotated[int, typer.Option(min=1, help="Sequences of each scene.")] = 2,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first.")] = 0,
    distance: Annotated[float, typer.Option(min=1.2, help="Of each drive, metres.")] = 4.0,
    disturb: Disturb = "",
    record: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Setting of the recordings; may be repeated."),
    ] = None,
    reference: Annotated[
        str, typer.Option(help="Estimator in whose time times are told.")
    ] = "corner_flow",
    level: Annotated[float, typer.Option(help="Of false alarms.")] = 0.05,
    tolerance: Annotated[
        float, typer.Option(help="Drift that grew by certainly more regresses.")
    ] = 0.005,
    margin: Annotated[float, typer.Option(help="Drift that grew by certainly less passes.")] = 0.1,
    time_margin: Annotated[float, typer.Option(help="Both for time; 0: not gated.")] = 0.25,
    nees_margin: Annotated[float, typer.Option(help="Both for NEES; 0: not gated.")] = 0.5,
) -> None:
    """Compare an estimator with a baseline over the same sequences: does it drift more?

    Exit status: 0 pass, 1 regress, 3 undecided, 2 bad input.
    """
    _refuse_others(ctx, bless)
    choice = _choice(estimator, command, timeout, label, overrides or [], config)
    if not bless:
        files = {"json": json_file, "markdown": markdown, "junit": junit}
        _compare(baseline, choice, accept, plan, files, cache)
        return
    from trials.cli import console
    from trials.gate import comparison
    from trials.gate.baseline import write_baseline
    from trials.gate.design import Design
    from trials.gate.rules import Rules
    from vo.contract.settings import validated

    design = {
        "scenes": _named(scenes),
        "seeds": seeds,
        "first_seed": first_seed,
        "disturb": disturb,
        "overrides": [f"drive.distance_m={distance:g}", *(record or [])],
    }
    rules = {
        "level": level,
        "drift_tolerance": tolerance,
        "drift_margin": margin,
        "time_margin": time_margin,
        "nees_margin": nees_margin,
    }
    made = comparison.bless(
        choice,
        reference,
        validated(Rules, rules),
        validated(Design, design),
        cache,
        console.counting_bar,
    )
    write_baseline(baseline, made)
    _tell_blessed(baseline, made)


def _refuse_others(ctx: typer.Context, bless: bool) -> None:
    """Refuse options that would be ignored.

    Raises:
        SettingsError: If there is one.
    """
    from vo.contract.errors import SettingsError

    for name in COMPARE if bless else BLESS:
        source = ctx.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            option = "--" + name.removesuffix("_file").replace("_", "-")
            raise SettingsError(f"{option}: {'not with' if bless else 'only with'} --bless")


def _compare(
    path: Path,
    choice: "Named | Command",
    accept: str,
    plan: str,
    files: dict[str, Path | None],
    cache: Path,
) -> None:
    from trials.cli import console
    from trials.gate import comparison
    from trials.gate.baseline import read_baseline
    from trials.gate.reports import write_reports
    from trials.gate.tables import plan_line

    accepted, change = _accepted(accept), _log_change(plan)
    known = read_baseline(path)
    found = comparison.compare(path, known, choice, accepted, cache, console.counting_bar)
    write_reports(found, files)
    _show(found)
    if change is not None:
        console.out.print(plan_line(found, change), markup=False)
    raise typer.Exit(EXIT[found.decision.verdict.value])


def _choice(
    estimator: str | None,
    command: str | None,
    timeout: float,
    label: str,
    overrides: list[str],
    config: Path | None,
) -> "Named | Command":
    from trials.estimators.choice import Named
    from vo.contract.errors import SettingsError

    if command is None:
        return Named(estimator or "driftyard", config, tuple(overrides))
    if estimator or overrides or config:
        raise SettingsError("--command: takes no --estimator, --set or --config")
    from trials.estimators.plugins.command import Command

    return Command(command, timeout, label)


def _named(scenes: str) -> list[str]:
    from scenes import SCENES
    from vo.contract.errors import SettingsError

    if not scenes:
        raise SettingsError(f"--bless: needs --scenes; valid: all, {', '.join(SCENES)}")
    return list(SCENES) if scenes == "all" else scenes.split(",")


def _accepted(accept: str) -> list[str]:
    from trials.gate.baseline import MISMATCHES
    from vo.contract.errors import SettingsError

    chosen = [name for name in accept.split(",") if name]
    for name in chosen:
        if name not in MISMATCHES:
            raise SettingsError(f"--accept: unknown {name}; valid: {', '.join(MISMATCHES)}")
    return chosen


def _log_change(plan: str) -> float | None:
    """Parse `5%` or `5`; None for nothing."""
    from math import inf, log1p

    from vo.contract.errors import SettingsError

    if not plan:
        return None
    try:
        change = float(plan.strip().removesuffix("%"))
    except ValueError:
        change = -inf
    if not 0.1 <= change <= 1000:
        raise SettingsError(f"--plan {plan}: expected a change from 0.1 % to 1000 %, such as 5%")
    return log1p(change / 100)


def _show(found: "Comparison") -> None:
    from rich.table import Table

    from trials.cli import console
    from trials.gate.tables import HEADER, headline, notes, rows

    table = Table(*HEADER, box=None)
    for column in table.columns[1:-1]:
        column.justify = "right"
    for row in rows(found):
        table.add_row(*row)
    console.out.print(table)
    for line in [*notes(found), headline(found)]:
        console.out.print(line, markup=False)


def _tell_blessed(path: Path, made: "Baseline") -> None:
    from trials.cli import console
    from trials.gate.statistics import LEAST_DEGREES, degrees_of_freedom

    lost = sum(x.is_lost for x in made.measured)
    console.out.print(
        f"{path}: {made.estimator} on {len(made.sequences)} sequences, {lost} of them lost",
        markup=False,
    )
    if degrees_of_freedom(made.scenes) < LEAST_DEGREES:
        console.err.print(f"{path}: too few sequences to decide anything; see docs/gate.md")
