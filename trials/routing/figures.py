"""The figures of the routing study."""

from collections.abc import Mapping
from dataclasses import astuple
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.routing.drive import STRATEGIES, Delays, drive
from trials.routing.network import Network
from trials.routing.study import (
    NODE_S,
    QUEUE_S,
    Case,
    Randomised,
    Study,
    Sweep,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, RED, BLUE, OCHRE, PALE = "#2b3036", "#c8401e", "#2a6fb0", "#b5820e", "#d4d7da"
STYLES = ((INK, "-"), (RED, "-"), (BLUE, "--"), (OCHRE, "--"))
"""Of the strategies, in their order: dashed with clearing."""


def draw_networks(studies: Mapping[str, Study]) -> "Figure":
    """Draw each network with its first case: congested roads, the static and the dynamic route."""
    figure = _figure(4.6 * len(studies) + 0.6, 5.2)
    panels = figure.subplots(1, len(studies), squeeze=False)[0]
    for panel, (name, study) in zip(panels, studies.items(), strict=True):
        _draw_network(panel, study.network, study.cases[0])
        panel.set_title(name, fontsize=10, weight="bold", loc="left")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def _routes(network: Network, case: Case) -> list[tuple[int, ...]]:
    """Nodes that static and dynamic routing pass without clearing, with half the longest delays."""
    queues = {road: (onset_s, QUEUE_S) for road, onset_s in case.onsets_s.items()}
    delays = Delays(np.full(len(network.names), NODE_S), queues, 0.0)
    return [drive(network, delays, case.start, case.goal, s).nodes for s in STRATEGIES[:2]]


def _draw_network(panel: "Axes", network: Network, case: Case) -> None:
    from matplotlib.collections import LineCollection

    km = network.xy_m / 1000
    roads = [(a, b) for a, b in network.lengths_m if a < b or (b, a) not in network.lengths_m]
    calm = [km[list(road)] for road in roads if road not in case.onsets_s]
    full = [km[list(road)] for road in roads if road in case.onsets_s]
    panel.add_collection(LineCollection(calm, colors=PALE, linewidths=1.0))
    full_roads = LineCollection(
        full, colors="#e9b44c", linewidths=2.0, label="congested on the way"
    )
    panel.add_collection(full_roads)
    full_roads.set_zorder(3)
    static, dynamic = _routes(network, case)
    for nodes, colour, width, label, order in (
        (static, INK, 5.0, "static route", 2),
        (dynamic, RED, 1.6, "dynamic route", 4),
    ):
        x, y = km[list(nodes)].T
        panel.plot(x, y, color=colour, linewidth=width, label=label, zorder=order)
    ends = km[[case.start, case.goal]]
    panel.plot(*ends.T, "o", color=INK, markersize=7, mfc="white", label="start, goal", zorder=5)
    panel.set_aspect("equal", adjustable="datalim")
    panel.autoscale_view()
    panel.set_xlabel("x, km", fontsize=9)
    panel.set_ylabel("y, km", fontsize=9)
    _clean(panel)


def draw_delays(studies: Mapping[str, Study]) -> "Figure":
    """Draw travel time over node delay and over queuing delay, a row a network."""
    figure = _figure(9.0, 3.4 * len(studies) + 0.5)
    panels = figure.subplots(len(studies), 2, squeeze=False, sharex="col", sharey="row")
    for row, (name, study) in zip(panels, studies.items(), strict=True):
        _draw_sweep(row[0], study.node)
        _draw_sweep(row[1], study.queue)
        row[0].set_ylabel("travel time, min", fontsize=9)
        row[0].set_title(
            f"{name}, queues of {QUEUE_S / 60:g} min", fontsize=9, weight="bold", loc="left"
        )
        row[1].set_title(
            f"{name}, waits of {NODE_S / 60:g} min", fontsize=9, weight="bold", loc="left"
        )
    panels[-1, 0].set_xlabel("waiting at every node, min", fontsize=9)
    panels[-1, 1].set_xlabel("delay on every congested road, min", fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def _draw_sweep(panel: "Axes", sweep: Sweep) -> None:
    delays_min = sweep.delays_s / 60
    for strategy, times_s, (colour, style) in zip(STRATEGIES, sweep.times_s, STYLES, strict=True):
        mean, low, high = np.transpose([astuple(mean_interval(x / 60)) for x in times_s])
        panel.plot(delays_min, mean, style, color=colour, linewidth=1.7, label=strategy.name)
        panel.fill_between(delays_min, low, high, color=colour, alpha=0.12, linewidth=0)
    panel.set_ylim(bottom=0)
    panel.margins(x=0.02)
    _clean(panel)


def draw_random(drives: Randomised, name: str, rng: np.random.Generator) -> "Figure":
    """Draw the increase over the undelayed time: drives as dots, means with their intervals."""
    figure = _figure(7.2, 4.2)
    panel = figure.subplots()
    for k, (increase, (colour, _)) in enumerate(zip(drives.increase_percent, STYLES, strict=True)):
        across = k + rng.uniform(-0.24, 0.24, len(increase))
        panel.plot(across, increase, ".", color=colour, alpha=0.35, markersize=4, zorder=2)
        mean, low, high = astuple(mean_interval(increase))
        panel.errorbar(
            k + 0.3,
            mean,
            yerr=[[mean - low], [high - mean]],
            fmt="D",
            color=colour,
            markersize=5,
            capsize=4,
            zorder=3,
        )
        panel.annotate(
            f"{mean:.0f} %",
            (k + 0.3, mean),
            (8, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            color=colour,
        )
    panel.set_xticks(range(len(STRATEGIES)), [s.name for s in STRATEGIES], fontsize=9)
    panel.set_xlim(-0.4, len(STRATEGIES) - 0.35)
    panel.set_ylim(bottom=0)
    panel.set_ylabel("increase over the undelayed time, %", fontsize=9)
    drawn = f"{drives.times_s.shape[1]} random drives; diamonds: mean with 95 % interval"
    panel.set_title(f"{name}, {drawn}", fontsize=9, weight="bold", loc="left")
    _clean(panel)
    return figure


def _figure(width: float, height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _clean(panel: "Axes") -> None:
    panel.grid(color="#eeeeee", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.tick_params(labelsize=8)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
