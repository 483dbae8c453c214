"""Figure of the rover's drives on routes: one world from above, and times beside the model's."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trials.gym.studies.aisle_network import AisleNetwork
from trials.gym.studies.rover_routing import RoverDrive
from trials.gym.world.free_space import NO_GEOM, FreeSpace
from trials.report.figure import BLUE, GREEN, GREY, INK, OCHRE, PALE, RED, shared_legend, tidy
from trials.routing.drive import STRATEGIES

SIZE_IN = (9.6, 4.2)
COLOURS = (INK, RED, BLUE, OCHRE)
"""Colours of the strategies, in their order."""
WIDTHS = (7.0, 4.8, 2.8, 1.2)
"""Widths of their paths, points: drawn on top of each other, all stay visible."""


def most_varied_layout(drives: Sequence[RoverDrive]) -> int:
    """Return the layout with the most different routes, then with the largest range of times."""

    def variety(layout: int) -> tuple[int, float]:
        here = [d for d in drives if d.layout == layout]
        return len({d.passed for d in here}), float(np.ptp([d.measured_s for d in here]))

    return max({d.layout for d in drives}, key=variety)


def draw_drives(
    figure: Figure,
    drives: Sequence[RoverDrive],
    layout: int,
    aisles: AisleNetwork,
    space: FreeSpace,
) -> None:
    """Draw the paths in the world of `layout`, and the times in all worlds."""
    above, times = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    _draw_world(above, [d for d in drives if d.layout == layout], aisles, space)
    above.set_title(f"layout {layout}")
    _draw_times(times, drives)
    shared_legend(figure, [above, times])


def _draw_world(
    panel: Axes, drives: Sequence[RoverDrive], aisles: AisleNetwork, space: FreeSpace
) -> None:
    height, width = space.obstacles.shape
    corners = space.points(np.array([[-0.5, -0.5], [height - 0.5, width - 0.5]]))
    (left, right), (bottom, top) = corners.T.tolist()
    panel.imshow(
        np.where(space.obstacles != NO_GEOM, 1.0, np.nan), cmap="Greys", vmin=0, vmax=3,
        extent=(left, right, bottom, top), origin="lower",
    )  # fmt: skip
    for slots, colour, label in (
        (aisles.doors.values(), GREEN, "door"),
        (list(aisles.loads.values())[::2], PALE, "room for a load"),
    ):
        for k, slot in enumerate(slots):
            panel.fill(*slot.corners.T, color=colour, lw=2, label=label if k == 0 else None)
    by_name = {d.strategy: d for d in drives}
    for strategy, colour, width_pt in zip(STRATEGIES, COLOURS, WIDTHS, strict=True):
        path = by_name[strategy.name].trace
        panel.plot(*path.T, color=colour, lw=width_pt, label=strategy.name, solid_capstyle="round")
    panel.plot(*drives[0].trace[0], "o", color=INK, mfc="white", ms=7, zorder=5)
    panel.set_aspect("equal")
    tidy(panel, "x, m", "y, m")
    panel.grid(visible=False)


def _draw_times(panel: Axes, drives: Sequence[RoverDrive]) -> None:
    for layout in sorted({d.layout for d in drives}):
        here = {d.strategy: d.measured_s for d in drives if d.layout == layout}
        panel.plot([here[s.name] for s in STRATEGIES], color=GREY, lw=0.8, marker=".", zorder=1)
    for k, (strategy, colour) in enumerate(zip(STRATEGIES, COLOURS, strict=True)):
        mine = [d for d in drives if d.strategy == strategy.name]
        predicted_s, measured_s = np.mean([(d.predicted_s, d.measured_s) for d in mine], axis=0)
        panel.plot(k - 0.1, predicted_s, "D", color=colour, mfc="white", ms=8, mew=1.6)
        panel.plot(k + 0.1, measured_s, "D", color=colour, ms=8)
        panel.annotate(
            f"{measured_s:.0f} s", (k + 0.1, measured_s), (7, 0), textcoords="offset points",
            va="center", fontsize=8.5, color=colour,
        )  # fmt: skip
    panel.set_xticks(range(len(STRATEGIES)), [s.name.replace(" + ", " +\n") for s in STRATEGIES])
    panel.set_ylim(0, 1.08 * max(d.measured_s for d in drives))
    panel.set_xlim(-0.4, len(STRATEGIES) - 0.4)
    tidy(panel, "", "travel time, s", "mean of the model (hollow) and of the rover")
