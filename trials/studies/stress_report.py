"""Report of stress tests: figures, their data, and a page of all axes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trials.report.figure import GREY, SERIES, save_figure, tidy
from trials.report.tables import markdown_table, write_csv
from trials.studies.stress import Curve, describe
from vo.contract.files import write_text

SCHEMA = "driftyard stress 2"
SIZE_IN = (7.0, 4.8)
CAPTION = """Crosses are drives that have failed, dots the others, lines the medians over drives.
The estimator of the same colour fails within the shaded interval. Dashed: limits of a failure."""


def write_curves(name: str, curves: Mapping[str, Curve], out: Path) -> Path:
    """Write FILE.png, .csv and .json of one axis and scene into a folder; returns the PNG."""
    scene = next(iter(curves.values())).scene
    labels = "-".join(label.replace(":", "_") for label in curves)
    stem = out / f"{name}-{scene}-{labels}"
    title = f"{name.replace('_', ' ')}, on {scene}"
    save_figure(stem.with_suffix(".png"), SIZE_IN, lambda figure: _draw(figure, curves, title))
    unit = next(iter(curves.values())).axis.label
    header = ("estimator", unit, "seed", "drift over 1 m, %", "frames lost, %")
    write_csv(stem.with_suffix(".csv"), header, rows_of(curves))
    content = {
        "schema": SCHEMA,
        "axis": name,
        "scene": scene,
        "estimators": {
            label: {"sentence": describe(x), "bracket": x.bracket, "limits": vars(x.limits)}
            for label, x in curves.items()
        },
    }
    write_text(stem.with_suffix(".json"), json.dumps(content, indent=1) + "\n")
    return stem.with_suffix(".png")


def rows_of(curves: Mapping[str, Curve]) -> list[tuple[str | float, ...]]:
    """Return estimator, strength, seed, drift, % and lost frames, % of each drive."""
    return [
        (label, x.strength, seed, drift, 100 * lost)
        for label, curve in curves.items()
        for x in curve.responses
        for seed, drift, lost in zip(x.seeds, x.drift_percent, x.lost_share, strict=True)
    ]


def _draw(figure: Figure, curves: Mapping[str, Curve], title: str) -> None:
    """Draw drift (top) and lost frames (bottom) over strength, failed drives as crosses."""
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    one = next(iter(curves.values()))
    for (label, curve), colour in zip(curves.items(), SERIES, strict=False):
        _draw_curve(top, bottom, curve, label, colour)
    for panel, limit in ((top, one.limits.drift_percent), (bottom, 100 * one.limits.lost_share)):
        panel.axhline(limit, color=GREY, ls="--", lw=0.9)
    top.set_yscale("log")
    top.yaxis.set_major_formatter("{x:g}")
    figure.legend(ncols=len(curves), loc="outside lower center")
    tidy(top, "", "drift over 1 m, %", title)
    tidy(bottom, one.axis.label, "frames lost, %")
    bottom.set_ylim(-5, 105)


def _draw_curve(top: Axes, bottom: Axes, curve: Curve, label: str, colour: str) -> None:
    for x in curve.responses:
        failed = x.failed(curve.limits)
        for drift, lost, fails in zip(x.drift_percent, x.lost_share, failed, strict=True):
            mark = "x" if fails else "o"
            top.plot(x.strength, drift, mark, color=colour, ms=4.5)
            bottom.plot(x.strength, 100 * lost, mark, color=colour, ms=4.5)
    strengths = [x.strength for x in curve.responses]
    medians = [_median(x.drift_percent) for x in curve.responses]
    top.plot(strengths, medians, color=colour, lw=1.2, label=label)
    losses = [100 * _median(x.lost_share) for x in curve.responses]
    bottom.plot(strengths, losses, color=colour, lw=1.2)
    if curve.bracket and curve.bracket[1] > curve.axis.minimum:
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
    """Write all axes, made by a command line, as Markdown; copy the figures beside the page."""
    pictures = page.parent / "images" / "stress"
    pictures.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        (pictures / f"{name}.png").write_bytes(figure.read_bytes())
    write_text(page, page_text(studies, command))


def page_text(studies: Mapping[str, Mapping[str, Curve]], command: str) -> str:
    """Return the page as Markdown; the folder `images/stress` holds the figures."""
    labels = list(next(iter(studies.values())))
    one = next(iter(studies[next(iter(studies))].values()))
    rows: list[list[str]] = []
    sections: list[str] = []
    for name, curves in studies.items():
        first = curves[labels[0]]
        rows.append([first.axis.label, first.scene, *(_where(curves[x]) for x in labels)])
        sentences = [f"- **{label}**: {describe(curve)}\n" for label, curve in curves.items()]
        sections.append(
            f"## {name.replace('_', ' ').capitalize()}\n\n{''.join(sentences)}\n"
            f"![Drift and lost frames over {name}](images/stress/{name}.png)\n"
        )
    table = markdown_table(["axis", "scene", *(f"{label} fails at" for label in labels)], rows)
    limits = (
        f"A drive has failed if its drift over 1 m exceeds {one.limits.drift_percent:g} % or it "
        f"loses more than {100 * one.limits.lost_share:g} % of the frames. An estimator fails at a "
        f"strength at which more than half of {len(one.responses[0].seeds)} drives have failed; "
        "the strength is found by bisection."
    )
    intro = f"# Stress tests\n\n{limits} {CAPTION} Made by\n\n```sh\n{command}\n```\n"
    return "\n".join([intro, table, "", *sections])


def _where(curve: Curve) -> str:
    if curve.bracket is None:
        return f"none up to {curve.responses[-1].strength:.3g}"
    low, high = curve.bracket
    return f"{low:.3g} to {high:.3g}" if high > low else f"{high:g}: undisturbed"
