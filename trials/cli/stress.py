"""Turning one disturbance up until the estimator breaks: `driftyard stress`."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from trials.execution.jobs import Variant
    from trials.studies.strengths import Axis
    from trials.studies.stress import Curve


def stress(
    axis: Annotated[
        str,
        typer.Argument(
            metavar="AXIS",
            help="exposure, brick_height, noise, calibration, texture, speed, all of these, "
            "or a disturbance's name; several as a,b.",
        ),
    ],
    scene: Annotated[
        str | None, typer.Option(help="Where to drive.", show_default="one that suits the axis")
    ] = None,
    estimator: Annotated[
        str,
        typer.Option(metavar="NAME", help="driftyard, thesis, corner_flow or module:Class; "
                                          "several as a,b."),
    ] = "driftyard",
    command: Annotated[
        str, typer.Option(metavar="CMD", help="Or a program, as for `driftyard run`.")
    ] = "",
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override the estimator's settings."),
    ] = None,
    most: Annotated[
        float | None, typer.Option(min=0, help="Strongest to try.", show_default="by axis")
    ] = None,
    points: Annotated[int, typer.Option(min=2, help="Strengths to begin with.")] = 5,
    rounds: Annotated[int, typer.Option(min=0, help="Halvings towards the breaking point.")] = 4,
    seeds: Annotated[int, typer.Option(min=1, help="Drives at every strength.")] = 3,
    distance: Annotated[float, typer.Option(min=1.2, help="Of each drive, metres.")] = 4.0,
    drift: Annotated[float, typer.Option(min=0, help="Drift that counts as broken, %.")] = 2.0,
    lost: Annotated[float, typer.Option(min=0, help="Lost frames that do, %.")] = 5.0,
    out: Annotated[Path, typer.Option(help="Folder of figures and data.")] = Path("build/stress"),
    page: Annotated[
        Path | None, typer.Option(help="Also write this Markdown page of all axes.")
    ] = None,
) -> None:  # fmt: skip
    """Drive with more and more of one thing, and find where the estimator breaks."""
    from trials.cli import console
    from trials.execution.runner import NO_LABELS, run_jobs
    from trials.studies.stress import Limits, responder
    from trials.studies.stress import stress as turn_up
    from trials.studies.stress_report import write_curves, write_page

    axes = _axes(axis, most)
    variants = _variants(estimator, command, tuple(overrides or ()))
    shared = (f"drive.distance_m={distance:g}", *NO_LABELS)
    studies: dict[str, dict[str, Curve]] = {}
    figures: dict[str, Path] = {}
    for name, chosen in axes.items():
        place = scene or chosen.scene
        studies[name] = {}
        for variant in variants:
            what = f"{variant.label}: {name} on {place}"
            with console.counting_bar(what, seeds * (points + rounds)) as count:
                respond = responder(
                    chosen, place, variant, tuple(range(seeds)), shared,
                    lambda jobs: run_jobs(jobs, progress=count),
                )  # fmt: skip
                curve = turn_up(chosen, place, respond, points, rounds, Limits(drift, lost / 100))
            studies[name][variant.label] = curve
            _print(curve, what)
        figures[name] = write_curves(name, studies[name], out)
        console.out.print(f"{figures[name]}, .csv, .json\n")
    if page:
        write_page(studies, figures, shlex.join(["driftyard", *sys.argv[1:]]), page)
        console.out.print(f"{page}")


def _axes(names: str, most: float | None) -> "dict[str, Axis]":
    from dataclasses import replace

    from trials.studies.strengths import AXES, MAIN
    from vo.contract.errors import SettingsError

    chosen = list(MAIN) if names == "all" else names.split(",")
    for name in chosen:
        if name not in AXES:
            raise SettingsError(f"unknown axis {name}; valid: all, {', '.join(AXES)}")
    return {x: AXES[x] if most is None else replace(AXES[x], reach=most) for x in chosen}


def _variants(estimators: str, command: str, overrides: tuple[str, ...]) -> "list[Variant]":
    from trials.estimators.plugins.command import Command
    from trials.execution.jobs import Variant

    if command:
        return [Variant(Command(command).name, estimators, overrides, command)]
    return [Variant(name, name, overrides) for name in estimators.split(",")]


def _print(curve: "Curve", title: str) -> None:
    import numpy as np
    from rich.table import Table

    from trials.cli import console
    from trials.studies.stress import verdict

    table = Table(
        curve.axis.label, "drift over 1 m, %, by drive", "lost, %", "broken", title=title,
        title_justify="left",
    )  # fmt: skip
    for x in curve.responses:
        drifts = " ".join("–" if np.isnan(d) else f"{d:.3f}" for d in x.drift_percent)
        broken = f"{sum(x.broken(curve.limits))} of {len(x.seeds)}"
        table.add_row(f"{x.strength:.4g}", drifts, f"{100 * np.mean(x.lost_share):.1f}", broken)
    console.out.print(table)
    limits = curve.limits
    console.out.print(
        f"{verdict(curve)} Broken: drift over {limits.drift_percent:g} % or more than "
        f"{100 * limits.lost_share:g} % of the frames lost, on most drives."
    )
