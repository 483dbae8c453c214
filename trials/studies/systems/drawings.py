"""Drawings of a comparison: each metric by scene, and drift over time per frame."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from trials.evaluation.intervals import Interval
from trials.report.figure import INK, SERIES, Draw, tidy
from trials.studies.systems.comparison import ALL, DRIFT, TIME, Metric, SystemComparison

Sized = tuple[tuple[float, float], Draw]
"""Width and height of a drawing, inches, and the drawing."""
WIDTH_IN = 7.6
PLAIN = FuncFormatter(lambda x, _: f"{x:g}")


def by_scene(comparison: SystemComparison, metric: Metric) -> Sized:
    """Return size and drawing of the median and interval of each system, in rows of scenes."""
    names, scenes = list(comparison.systems), comparison.scenes
    rows = [*scenes, ALL] if len(scenes) > 1 else scenes
    size_in = (WIDTH_IN, 0.9 + len(rows) * (0.18 + 0.11 * len(names)))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        values: list[float] = []
        for k, (name, colour) in enumerate(zip(names, cycle(SERIES))):
            shift = 0.8 * ((k + 0.5) / len(names) - 0.5)
            for row, scene in enumerate(rows):
                found = comparison.interval(name, metric.name, scene)
                _draw_interval(panel, found, row + shift, colour, name if row == 0 else None)
                values.append(found.value)
        for row in range(1, len(rows)):
            panel.axhline(row - 0.5, color="#d5d5d5", linewidth=0.6)
        panel.set_yticks(range(len(rows)), rows)
        panel.set_ylim(len(rows) - 0.5, -0.5)
        if metric.name == "lost":
            panel.set_xlim(-2, 102)
        elif _are_positive(values):
            _log_axis(panel, "x")
        tidy(panel, metric.label, "")
        panel.grid(False, axis="y")
        panel.tick_params(axis="y", length=0)

    return size_in, draw


def drift_over_time(comparison: SystemComparison) -> Sized:
    """Return size and drawing of drift over time per frame, medians over all scenes."""

    def draw(figure: Figure) -> None:
        panel, shown = figure.subplots(), list[float]()
        for k, (name, colour) in enumerate(zip(comparison.systems, cycle(SERIES))):
            drift, time = (comparison.interval(name, x.name) for x in (DRIFT, TIME))
            if not np.isfinite([drift.value, time.value]).all():
                continue
            shown += [time.value, drift.value]
            panel.errorbar(
                time.value, drift.value, _bars(drift), _bars(time),
                fmt="o", color=colour, markersize=6, linewidth=1.1,
            )  # fmt: skip
            place = {"xytext": (7, -12 if k % 2 else 5), "textcoords": "offset points"}
            panel.annotate(name, (time.value, drift.value), fontsize=8, color=INK, **place)
        if _are_positive(shown):
            for axis in "xy":
                _log_axis(panel, axis)
        panel.margins(0.15)
        tidy(panel, TIME.label, DRIFT.label)

    return (WIDTH_IN, 4.0), draw


def _draw_interval(panel: Axes, found: Interval, y: float, colour: str, label: str | None) -> None:
    if not np.isfinite(found.value):
        panel.plot([], [], "o", color=colour, label=label)
        return
    if np.isfinite(found.low):
        panel.plot([found.low, found.high], [y, y], color=colour, linewidth=1.4)
    panel.plot(found.value, y, "o", color=colour, markersize=4.5, label=label)


def _are_positive(values: Sequence[float]) -> bool:
    """Whether there are values for a logarithmic axis, and all are; NaN is none."""
    known = [x for x in values if np.isfinite(x)]
    return len(known) > 0 and min(known) > 0


def _bars(found: Interval) -> Sequence[Sequence[float]] | None:
    if not np.isfinite(found.low):
        return None
    return [[max(found.value - found.low, 0)], [max(found.high - found.value, 0)]]


def _log_axis(panel: Axes, name: str) -> None:
    """Make an axis logarithmic, with plain numbers, also at minor ticks of a short range."""
    getattr(panel, f"set_{name}scale")("log")
    axis = getattr(panel, f"{name}axis")
    low, high = sorted(axis.get_view_interval())
    axis.set_major_formatter(PLAIN)
    axis.set_minor_formatter(PLAIN if high < 12 * low else FuncFormatter(lambda x, _: ""))
    axis.set_tick_params(which="minor", labelsize=7)
