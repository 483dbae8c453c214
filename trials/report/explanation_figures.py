"""Figures of explanations: shares of the stages, shares along the path, and calibration."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trials.diagnosis.attribution import REMAINDER, Attribution
from trials.diagnosis.explanation import Explanation
from trials.evaluation.consistency import calibration
from trials.evaluation.intervals import Interval
from trials.report.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    OCHRE,
    PURPLE,
    RED,
    grid_of_panels,
    save_figure,
    shared_legend,
    tidy,
)
from vo.contract.arrays import Array

COLOURS = {
    "prediction": PURPLE,
    "matching": RED,
    "matches": RED,
    "features": OCHRE,
    "stereo": BLUE,
    "inliers": GREEN,
    REMAINDER: GREY,
}
BIN_M = 0.25
"""Bin width along the path, metres."""
COLUMNS = 3
T = TypeVar("T")
KINDS = {"step": "frame to frame", "over_1m": "over 1 m", "absolute": "since the start"}
"""Kind of NEES to its label."""


def draw_figures(explanations: Sequence[Explanation], out: Path) -> dict[str, Path]:
    """Draw `shares`, `path` and `calibration` into a folder, each with a panel for each scene.

    Returns the PNG files by name; a figure without data is left out.
    """
    attributed = {x.name: x.attribution for x in explanations if x.attribution}
    with_nees = {x.name: x for x in explanations if x.nees}
    figures: dict[str, Path] = {}
    if attributed:
        figures["shares"] = _save_panels(out / "shares.png", attributed, _waterfall)
        figures["path"] = _save_panels(out / "path.png", attributed, _path, legend=True)
    if with_nees:
        name = "calibration"
        figures[name] = _save_panels(out / f"{name}.png", with_nees, _calibration, legend=True)
    return figures


def _save_panels(
    out: Path, parts: Mapping[str, T], draw: Callable[[Axes, T], None], legend: bool = False
) -> Path:
    """Save a figure with a titled panel for each part."""

    def draw_all(figure: Figure) -> None:
        panels = grid_of_panels(figure, len(parts), COLUMNS)
        for panel, (name, part) in zip(panels, parts.items(), strict=True):
            draw(panel, part)
            panel.set_title(name)
        if legend:
            shared_legend(figure, panels)

    columns = min(COLUMNS, len(parts))
    save_figure(out, (3.5 * columns + 0.5, 2.9 * -(-len(parts) // columns) + 0.4), draw_all)
    return out


def _waterfall(panel: Axes, attribution: Attribution) -> None:
    """Draw the drift, the share of each stage, and the remainder."""
    level, shares = attribution.drift.value, attribution.shares
    panel.bar(0, level, color=INK, width=0.7)
    panel.errorbar(0, level, _error_bars(attribution.drift), color=GREY, capsize=3)
    for k, share in enumerate(shares[:-1], 1):
        below = level - share.drift.value
        panel.plot([k - 0.65, k + 0.35], [level, level], color=GREY, linewidth=0.7)
        colour = COLOURS[share.stage]
        panel.bar(k, -share.drift.value, bottom=level, color=colour, width=0.7)
        panel.errorbar(k, below, _error_bars(share.drift)[::-1], color=INK, capsize=3)
        level = below
    rest = shares[-1].drift
    panel.bar(len(shares), rest.value, color=GREY, width=0.7)
    panel.errorbar(len(shares), rest.value, _error_bars(rest), color=INK, capsize=3)
    panel.axhline(0, color=INK, linewidth=0.8)
    panel.set_xticks(range(len(shares) + 1), ["drift", *(x.stage for x in shares)])
    panel.tick_params(axis="x", rotation=28)
    tidy(panel, "", "drift over 1 m, %")


def _error_bars(interval: Interval) -> Array:
    """Return lengths (2, 1) of the error bars below and above a value."""
    value, low, high = interval.value, interval.low, interval.high
    return np.maximum([[value - low], [high - value]], 0.0)


def _path(panel: Axes, attribution: Attribution) -> None:
    """Draw shares along the path, means over drives."""
    at_m = np.concatenate([x for x, _ in attribution.by_segment.values()]) + 0.5
    shares = np.concatenate([x for _, x in attribution.by_segment.values()], axis=1)
    bins = np.floor(at_m / BIN_M).astype(int)
    filled = np.unique(bins)
    means = np.array([shares[:, bins == x].mean(axis=1) for x in filled]).T
    middle_m = (filled + 0.5) * BIN_M
    panel.plot(middle_m, means.sum(axis=0), color=INK, linewidth=2, label="drift")
    for share, mean in zip(attribution.shares, means, strict=True):
        panel.plot(middle_m, mean, color=COLOURS[share.stage], linewidth=1.4, label=share.stage)
    panel.axhline(0, color=INK, linewidth=0.6)
    tidy(panel, "middle of the segment, m along the path", "drift over 1 m, %")


def _calibration(panel: Axes, part: Explanation) -> None:
    """Draw errors inside ellipsoids of a given probability."""
    levels = np.linspace(0, 1, 101)[1:-1]
    panel.plot([0, 100], [0, 100], color=GREY, linewidth=1, linestyle="--", label="ideal")
    for (kind, label), colour in zip(KINDS.items(), (BLUE, RED, INK), strict=True):
        inside = calibration(part.pooled(kind), levels)
        panel.plot(100 * levels, 100 * inside, color=colour, linewidth=1.5, label=label)
    panel.set_aspect("equal")
    tidy(panel, "probability of the ellipsoid, %", "errors inside, %")
