"""The route map: routes with their direction, numbered positions, moving objects and scale."""

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from sim.preview.cameras import TopDownMap
from sim.preview.colours import FAINT, INK, round_down
from sim.world.rover import BODY
from sim.world.world import START_S, World
from vo.contract.arrays import Array

ROUTE = "#ff7a1a"
OTHERS = ("#4fc3f7", "#c6ff5e", "#ff8ad8", "#ffe14d", "#b39dff", "#7dffd4")
MOVES = "#ff3b5c"
MOVES_FOR_S = 20.0
ARROWS, TICKS = 6, 8
LIMB_M = 0.4
"""Distance below which moving bodies are parts of one object, drawn as one line."""
KEY_COLUMNS = 5
BAR_SHARE = 0.22
"""Largest length of the scale bar over the map's width."""


def draw_map(axes: Axes, world: World, top_down: TopDownMap, stops: Array, full: bool) -> None:
    """Draw the scene from above, with its path and numbered positions (S, 2) in world metres.

    A full map has other routes, moving objects, numbers and axes.
    """
    height, width = top_down.image.shape[:2]
    x, y, scale = top_down.x_min_m, top_down.y_max_m, top_down.metres_per_px
    extent = (x, x + width * scale, y - height * scale, y)
    axes.imshow(top_down.image, extent=extent, interpolation="antialiased")
    axes.set_xlim(extent[:2])
    axes.set_ylim(extent[2:])
    if full:
        outline = withStroke(linewidth=3.0, foreground="#00000080")
        dashed: dict[str, Any] = {"linewidth": 1.6, "linestyle": (0, (4, 1.6))}
        for route, color in zip(other_routes(world).values(), cycle(OTHERS), strict=False):
            _draw_route(axes, route, color, outline, 4, 14, **dashed)
        _draw_movers(axes, world)
    width_pt = 2.4 if full else 1.6
    outline = withStroke(linewidth=width_pt + 2.2, foreground="#ffffffc0")
    style: dict[str, Any] = {"linewidth": width_pt, "solid_capstyle": "round"}
    _draw_route(axes, world.path.waypoints, ROUTE, outline, ARROWS, 9 * width_pt, **style)
    _draw_stops(axes, stops)
    _draw_bar(axes, extent)
    if full:
        _draw_key(axes, world)
        axes.tick_params(labelsize=7, colors=FAINT, length=2, pad=2)
        axes.locator_params(axis="x", nbins=TICKS * min(width / height, 1))
        axes.locator_params(axis="y", nbins=TICKS * min(height / width, 1))
        axes.spines[:].set_visible(False)
    else:
        axes.set_axis_off()


def other_routes(world: World) -> dict[str, Array]:
    """Return the scene's routes besides the path, by name, in order."""
    way = world.path.waypoints
    routes = world.scene.routes.items()
    return {n: r for n, r in routes if not (r.shape == way.shape and np.allclose(r, way))}


def arrow_places(waypoints: Array, count: int) -> tuple[Array, Array]:
    """Return `count` positions (count, 2) evenly spaced along (N, 2) waypoints, and directions."""
    steps = np.diff(waypoints, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    marks = np.concatenate([[0.0], np.cumsum(lengths)])
    along = (np.arange(count) + 0.5) / count * marks[-1]
    k = np.clip(np.searchsorted(marks, along, side="right") - 1, 0, len(steps) - 1)
    directions = steps[k] / lengths[k, None]
    return waypoints[k] + (along - marks[k])[:, None] * directions, directions


def _draw_route(
    axes: Axes, waypoints: Array, color: str, outline: withStroke, arrows: int, size_pt: float,
    **style: Any,
) -> None:  # fmt: skip
    """Draw an outlined line with some arrows of a size along it."""
    axes.plot(*waypoints.T, color=color, path_effects=[outline], **style)
    shape = {"arrowstyle": "-|>", "mutation_scale": size_pt, "shrinkA": 0, "shrinkB": 0}
    for place, direction in zip(*arrow_places(waypoints, arrows), strict=True):
        axes.annotate("", place + 1e-3 * direction, place, arrowprops={"color": color, **shape})


def _draw_movers(axes: Axes, world: World) -> None:
    """Draw the path of each moving object for some seconds from the start."""
    times_s = START_S + np.linspace(0, MOVES_FOR_S, 81)
    starts: list[Array] = []
    for name, motion in world.movers.items():
        start = motion(START_S)[:2, 3]
        if name == BODY or any(np.linalg.norm(start - other) < LIMB_M for other in starts):
            continue
        starts.append(start)
        way = np.array([motion(float(t))[:2, 3] for t in times_s])
        axes.plot(*way.T, color=MOVES, linewidth=1.4, linestyle=(0, (1, 1.2)))
        axes.plot(*way[0], "o", color=MOVES, markersize=5, markeredgecolor="white")


def _draw_stops(axes: Axes, stops: Array) -> None:
    """Number the stops; overlapping numbers share a box."""
    x_min, x_max = axes.get_xlim()
    near_m = 0.03 * (x_max - x_min)
    groups: list[tuple[Array, list[int]]] = []
    for k, stop in enumerate(stops):
        for place, numbers in groups:
            if np.linalg.norm(place - stop) < near_m:
                numbers.append(k + 1)
                break
        else:
            groups.append((stop, [k + 1]))
    for (x, y), numbers in groups:
        face, ink = (ROUTE, "white") if 1 in numbers else ("white", INK)
        box = {"boxstyle": "circle,pad=0.28", "facecolor": face, "edgecolor": INK}
        if len(numbers) > 1:
            box["boxstyle"] = "round,pad=0.3,rounding_size=0.8"
        style: dict[str, Any] = {"color": ink, "ha": "center", "va": "center", "zorder": 5}
        axes.text(x, y, " ".join(map(str, numbers)), bbox=box, fontsize=8, weight="bold", **style)


def _draw_bar(axes: Axes, extent: tuple[float, float, float, float]) -> None:
    """Draw a scale bar of a round length into the lower left corner, its length above it."""
    width_m, height_m = extent[1] - extent[0], extent[3] - extent[2]
    length_m = round_down(BAR_SHARE * width_m)
    left, low = extent[0] + 0.03 * width_m, extent[2] + min(0.03 * width_m, 0.1 * height_m)
    middle, right = left + length_m / 2, left + length_m
    outline = [withStroke(linewidth=5.4, foreground="#000000a0")]
    style: dict[str, Any] = {"linewidth": 4, "solid_capstyle": "butt", "path_effects": outline}
    for ends, colour in (((left, middle), "white"), ((middle, right), INK)):
        axes.plot(ends, (low, low), color=colour, zorder=6, **style)
    outline = [withStroke(linewidth=2.2, foreground="#000000b0")]
    style = {"fontsize": 8, "color": "white", "weight": "bold", "path_effects": outline}
    above: dict[str, Any] = {"xytext": (0, 4), "textcoords": "offset points", "ha": "center"}
    axes.annotate(f"{length_m:g} m", (middle, low), zorder=6, **above, **style)


def _draw_key(axes: Axes, world: World) -> None:
    """Add a legend if there are more lines than the path."""
    others = other_routes(world)
    moving = [name for name in world.movers if name != BODY]
    if not others and not moving:
        return
    mine = next((name for name in world.scene.routes if name not in others), "own waypoints")
    lines = [(ROUTE, "-", mine)]
    lines += [(color, "--", name) for name, color in zip(others, cycle(OTHERS), strict=False)]
    if moving:
        lines.append((MOVES, ":", f"moving, {MOVES_FOR_S:g} s"))
    handles = [axes.plot([], [], color=c, linestyle=s, label=n)[0] for c, s, n in lines]
    look = {"fontsize": 8, "labelcolor": INK, "frameon": False, "ncols": KEY_COLUMNS}
    packed = {"borderpad": 0, "borderaxespad": 0.4, "handlelength": 1.8, "columnspacing": 1.4}
    axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1), **look, **packed)
