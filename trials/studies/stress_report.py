"""What a stress test leaves: a figure, its data, and a page of all axes."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trials.report.figure import GREY, SERIES, save_figure, tidy
from trials.studies.stress import Curve, verdict
from vo.contract.files import replacing, write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCHEMA = "driftyard stress 2"
SIZE_IN = (7.0, 4.8)
CAPTION = """Dots are drives that were survived, crosses drives that were not, lines their medians;
the shaded strip is where the estimator of its colour breaks. Dashed: beyond it a drive counts as
broken."""


def write_curves(name: str, curves: Mapping[str, Curve], out: Path) -> Path:
    """Write FILE.png, .csv and .json into a folder.

    Args:
        name: Of the axis.
        curves: Estimator's label to what it did; all of one axis and scene.
        out: Folder.

    Returns:
        The figure.
    """
    scene = next(iter(curves.values())).scene
    labels = "-".join(label.replace(":", "_") for label in curves)
    stem = out / f"{name}-{scene}-{labels}"
    title = f"{name.replace('_', ' ')}, on {scene}"
    save_figure(stem.with_suffix(".png"), SIZE_IN, lambda figure: draw(figure, curves, title))
    table = columns(curves)
    with replacing(stem.with_suffix(".csv")) as partial, partial.open("w", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(table)
        rows.writerows(zip(*table.values(), strict=True))
    content = {
        "schema": SCHEMA,
        "axis": name,
        "scene": scene,
        "estimators": {
            label: {
                "sentence": verdict(curve),
                "bracket": curve.bracket,
                "limits": vars(curve.limits),
            }
            for label, curve in curves.items()
        },
    }
    write_text(stem.with_suffix(".json"), json.dumps(content, indent=1) + "\n")
    return stem.with_suffix(".png")


def columns(curves: Mapping[str, Curve]) -> Mapping[str, list[str | float]]:
    """A row for each drive."""
    rows = [
        (label, response.strength, seed, drift, 100 * lost)
        for label, curve in curves.items()
        for response in curve.responses
        for seed, drift, lost in zip(
            response.seeds, response.drift_percent, response.lost_share, strict=True
        )
    ]
    unit = next(iter(curves.values())).axis.label
    names = ("estimator", unit, "seed", "drift over 1 m, %", "frames lost, %")
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def draw(figure: "Figure", curves: Mapping[str, Curve], title: str) -> None:
    """Drift over strength, drives as dots, broken ones as crosses; below, lost frames."""
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    one = next(iter(curves.values()))
    for (label, curve), colour in zip(curves.items(), SERIES, strict=False):
        _draw_curve(top, bottom, curve, label, colour)
    for panel, limit in ((top, one.limits.drift_percent), (bottom, 100 * one.limits.lost_share)):
        panel.axhline(limit, color=GREY, ls="--", lw=0.9)
    top.set_yscale("log")
    top.yaxis.set_major_formatter("{x:g}")
    figure.legend(fontsize=8, frameon=False, ncols=len(curves), loc="outside lower center")
    tidy(top, "", "drift over 1 m, %", title)
    tidy(bottom, one.axis.label, "frames lost, %")
    bottom.set_ylim(-5, 105)


def _draw_curve(top: "Axes", bottom: "Axes", curve: Curve, label: str, colour: str) -> None:
    for response in curve.responses:
        for drift, lost, broken in zip(
            response.drift_percent, response.lost_share, response.broken(curve.limits), strict=True
        ):
            mark = "x" if broken else "o"
            top.plot(response.strength, drift, mark, color=colour, ms=4.5)
            bottom.plot(response.strength, 100 * lost, mark, color=colour, ms=4.5)
    strengths = [x.strength for x in curve.responses]
    top.plot(strengths, [_median(x.drift_percent) for x in curve.responses], color=colour, lw=1.2,
             label=label)  # fmt: skip
    losses = [100 * _median(x.lost_share) for x in curve.responses]
    bottom.plot(strengths, losses, color=colour, lw=1.2)
    if curve.bracket and curve.bracket[1] > curve.axis.least:
        for panel in (top, bottom):
            panel.axvspan(*curve.bracket, color=colour, alpha=0.12, lw=0)


def _median(values: Sequence[float]) -> float:
    known = [x for x in values if np.isfinite(x)]
    return float(np.median(known)) if known else np.nan


def write_page(
    studies: Mapping[str, Mapping[str, Curve]],
    figures: Mapping[str, Path],
    command: str,
    page: Path,
) -> None:
    """Write all axes as Markdown, and copy the figures into `images/stress` beside it.

    Args:
        studies: Axis to estimator's label to what it did.
        figures: Axis to its figure.
        command: That made them.
        page: File to write.
    """
    pictures = page.parent / "images" / "stress"
    pictures.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        (pictures / f"{name}.png").write_bytes(figure.read_bytes())
    write_text(page, page_text(studies, command))


def page_text(studies: Mapping[str, Mapping[str, Curve]], command: str) -> str:
    """The page's Markdown; figures are looked for in `images/stress`."""
    labels = list(next(iter(studies.values())))
    one = next(iter(studies[next(iter(studies))].values()))
    head = " | ".join(["what grows", "where", *(f"{label} breaks at" for label in labels)])
    rows = [
        " | ".join([curves[labels[0]].axis.label, curves[labels[0]].scene,
                    *(_where(curves[label]) for label in labels)])
        for curves in studies.values()
    ]  # fmt: skip
    table = "\n".join(f"| {row} |" for row in [head, "|".join(["---"] * (2 + len(labels))), *rows])
    broken = (
        f"An estimator is broken where its drift over 1 m exceeds {one.limits.drift_percent:g} % "
        f"or it loses more than {100 * one.limits.lost_share:g} % of the frames, on more than "
        f"half of {len(one.responses[0].seeds)} drives at each strength; the strength is found by "
        "halving."
    )
    sections = [
        f"## {name.replace('_', ' ').capitalize()}\n\n"
        + "\n".join(f"- **{label}**: {verdict(curve)}" for label, curve in curves.items())
        + f"\n\n![Drift and loss over {name}](images/stress/{name}.png)\n"
        for name, curves in studies.items()
    ]
    intro = f"# How much it bears\n\n{broken} {CAPTION} Made by\n\n```sh\n{command}\n```\n"
    return "\n".join([intro, table, "", *sections])


def _where(curve: Curve) -> str:
    if curve.bracket is None:
        return f"none up to {curve.responses[-1].strength:.3g}"
    low, high = curve.bracket
    return f"{low:.3g} to {high:.3g}" if high > low else f"{high:g}: as it is"
