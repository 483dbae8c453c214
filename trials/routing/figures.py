"""Figures of the routing study, and their data as CSV."""

from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from trials.evaluation.intervals import mean_interval
from trials.report.figure import BLUE, GREY, INK, OCHRE, RED, shared_legend, tidy
from trials.report.tables import write_csv
from trials.routing.drive import STRATEGIES, Delays, drive
from trials.routing.network import Network
from trials.routing.study import NODE_S, QUEUE_S, Case, Randomised, Study, Sweep

STYLES = ((INK, "-"), (RED, "-"), (BLUE, "--"), (OCHRE, "--"))
"""Colour and line style of the strategies, in their order; dashed with clearing."""


def draw_networks(figure: Figure, studies: Mapping[str, Study]) -> None:
    """Draw each network with its first case: congested roads, the static and the dynamic route."""
    panels = figure.subplots(1, len(studies), squeeze=False)[0]
    for panel, (name, study) in zip(panels, studies.items(), strict=True):
        _draw_network(panel, study.network, study.cases[0])
        tidy(panel, "x, km", "y, km", name)
    shared_legend(figure, panels)


def _draw_network(panel: Axes, network: Network, case: Case) -> None:
    km = network.xy_m / 1000
    roads = [(a, b) for a, b in network.lengths_m if a < b or (b, a) not in network.lengths_m]
    free = [km[list(road)] for road in roads if road not in case.onsets_s]
    congested = [km[list(road)] for road in roads if road in case.onsets_s]
    panel.add_collection(LineCollection(free, colors=GREY, linewidths=0.6))
    yellow: dict[str, Any] = {"colors": "#e9b44c", "linewidths": 2.0, "zorder": 3}
    panel.add_collection(LineCollection(congested, label="congested on the way", **yellow))
    # Both routes without clearing, with half the longest delays.
    queues = {road: (onset_s, QUEUE_S) for road, onset_s in case.onsets_s.items()}
    delays = Delays(np.full(len(network.names), NODE_S), queues, 0.0)
    styles = ((INK, 5.0, 2), (RED, 1.6, 4))
    for strategy, (colour, width, order) in zip(STRATEGIES, styles, strict=False):
        nodes = drive(network, delays, case.start, case.goal, strategy).nodes
        label = f"{strategy.name} route"
        panel.plot(*km[list(nodes)].T, color=colour, linewidth=width, label=label, zorder=order)
    ends = km[[case.start, case.goal]]
    panel.plot(*ends.T, "o", color=INK, markersize=7, mfc="white", label="start, goal", zorder=5)
    panel.set_aspect("equal", adjustable="datalim")
    panel.autoscale_view()


def draw_delays(figure: Figure, studies: Mapping[str, Study]) -> None:
    """Draw travel time over node delay and over queuing delay, one row for each network."""
    panels = figure.subplots(len(studies), 2, squeeze=False, sharex="col", sharey="row")
    for row, (name, study) in zip(panels, studies.items(), strict=True):
        _draw_sweep(row[0], study.node)
        _draw_sweep(row[1], study.queue)
        tidy(row[0], "", "travel time, min", f"{name}, queues of {QUEUE_S / 60:g} min")
        tidy(row[1], "", "", f"{name}, waits of {NODE_S / 60:g} min")
    panels[-1, 0].set_xlabel("waiting at every node, min")
    panels[-1, 1].set_xlabel("delay on every congested road, min")
    shared_legend(figure, [*panels[0]])


def _draw_sweep(panel: Axes, sweep: Sweep) -> None:
    delays_min = sweep.delays_s / 60
    for strategy, times_s, (colour, style) in zip(STRATEGIES, sweep.times_s, STYLES, strict=True):
        mean, low, high = np.transpose([astuple(mean_interval(x / 60)) for x in times_s])
        panel.plot(delays_min, mean, style, color=colour, linewidth=1.7, label=strategy.name)
        panel.fill_between(delays_min, low, high, color=colour, alpha=0.12, linewidth=0)
    panel.set_ylim(bottom=0)
    panel.margins(x=0.02)


def draw_random(figure: Figure, drives: Randomised, name: str, rng: np.random.Generator) -> None:
    """Draw the increase over the undelayed time: drives as dots, means with their intervals."""
    panel = figure.subplots()
    for k, (increase, (colour, _)) in enumerate(zip(drives.increase_percent, STYLES, strict=True)):
        across = k + rng.uniform(-0.24, 0.24, len(increase))
        panel.plot(across, increase, ".", color=colour, alpha=0.35, markersize=4, zorder=2)
        mean, low, high = astuple(mean_interval(increase))
        panel.errorbar(
            k + 0.3, mean, [[mean - low], [high - mean]], fmt="D", color=colour, markersize=5,
            capsize=4, zorder=3,
        )  # fmt: skip
        panel.annotate(
            f"{mean:.0f} %", (k + 0.3, mean), (8, 0), textcoords="offset points", va="center",
            fontsize=9, color=colour,
        )  # fmt: skip
    panel.set_xticks(range(len(STRATEGIES)), [s.name for s in STRATEGIES], fontsize=9)
    panel.set_xlim(-0.4, len(STRATEGIES) - 0.35)
    panel.set_ylim(bottom=0)
    drawn = f"{drives.times_s.shape[1]} random drives; diamonds: mean with 95 % interval"
    tidy(panel, "", "increase over the undelayed time, %", f"{name}, {drawn}")


def write_delays(out: Path, studies: Mapping[str, Study]) -> None:
    """Write mean travel times with their intervals over both kinds of delay."""
    rows = [
        (name, over, delay_s, strategy.name, *(f"{x:.3f}" for x in astuple(mean_interval(samples))))
        for name, study in studies.items()
        for over, sweep in (("node", study.node), ("queue", study.queue))
        for strategy, times_s in zip(STRATEGIES, sweep.times_s, strict=True)
        for delay_s, samples in zip(sweep.delays_s.tolist(), times_s, strict=True)
    ]
    header = ("network", "over", "delay_s", "strategy", "mean_s", "low_s", "high_s")
    write_csv(out, header, rows)


def write_random(out: Path, drives: Randomised) -> None:
    """Write the travel times of every random drive."""
    times = zip(drives.free_s, *drives.times_s, strict=True)
    rows = ((k, *(f"{x:.3f}" for x in each)) for k, each in enumerate(times))
    write_csv(out, ("drive", "undelayed_s", *(f"{s.name}_s" for s in STRATEGIES)), rows)
