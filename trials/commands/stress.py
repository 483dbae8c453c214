"""Turning one disturbance up until the estimator breaks: `driftyard stress`."""

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from trials.stress import Curve


def stress(
    axis: Annotated[
        str,
        typer.Argument(
            metavar="AXIS", help="exposure, brick_height, speed, texture, or a disturbance's name."
        ),
    ],
    scene: Annotated[
        str | None, typer.Option(help="Where to drive.", show_default="one that suits the axis")
    ] = None,
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="driftyard, thesis, corner_flow or module:Class.")
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
    out: Annotated[Path, typer.Option(help="Folder of figure and data.")] = Path("build/stress"),
) -> None:
    """Drive with more and more of one thing, and find where the estimator breaks."""
    from dataclasses import replace

    from trials.commands import console
    from trials.lab import NO_LABELS, perform
    from trials.outcomes import Variant
    from trials.report.figure import save_figure
    from trials.stress import AXES, Limits, draw, responder, verdict
    from trials.stress import stress as turn_up
    from vo.contract.errors import SettingsError

    if axis not in AXES:
        raise SettingsError(f"unknown axis {axis}; valid: {', '.join(AXES)}")
    chosen = AXES[axis] if most is None else replace(AXES[axis], reach=most)
    place = scene or chosen.scene
    label = Path(command.split()[0]).name if command else estimator
    variant = Variant(label, estimator, tuple(overrides or ()), command)
    with console.counting_bar(f"{axis} on {place}", seeds * (points + rounds)) as count:
        respond = responder(
            chosen,
            place,
            variant,
            tuple(range(seeds)),
            (f"drive.distance_m={distance:g}", *NO_LABELS),
            lambda trials: perform(trials, progress=count),
        )
        curve = turn_up(chosen, place, respond, points, rounds, Limits(drift, lost / 100))
    name = f"{axis}-{place}-{label.replace(':', '_')}"
    title = f"{label}: {axis} on {place}"
    save_figure(out / f"{name}.png", (7.0, 4.6), lambda figure: draw(figure, curve, title))
    _write(curve, out / name, title, verdict(curve))
    console.out.print(_table(curve, title))
    console.out.print(f"{verdict(curve)}\n{out / name}.png, .csv, .json")


def _table(curve: "Curve", title: str) -> "Table":
    import numpy as np
    from rich.table import Table

    table = Table(
        curve.axis.label, "drift over 1 m, %, by drive", "lost, %", "broken", title=title,
        title_justify="left",
    )  # fmt: skip
    for x in curve.responses:
        drifts = " ".join("–" if np.isnan(d) else f"{d:.3f}" for d in x.drift_percent)
        broken = f"{sum(x.broken(curve.limits))} of {len(x.seeds)}"
        table.add_row(f"{x.strength:.4g}", drifts, f"{100 * np.mean(x.lost_share):.1f}", broken)
    return table


def _write(curve: "Curve", stem: Path, title: str, sentence: str) -> None:
    from trials.stress import columns
    from vo.contract.files import replacing, write_text

    table = columns(curve)
    with replacing(stem.with_suffix(".csv")) as partial, partial.open("w", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(table)
        rows.writerows(zip(*table.values(), strict=True))
    content = {
        "schema": "driftyard stress 1",
        "title": title,
        "sentence": sentence,
        "bracket": curve.bracket,
        "limits": {
            "drift_percent": curve.limits.drift_percent,
            "lost_share": curve.limits.lost_share,
        },
    }
    write_text(stem.with_suffix(".json"), json.dumps(content, indent=1) + "\n")
