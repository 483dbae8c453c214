"""All scenes in one picture: name, what it tests, a view and the map of each."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scenes.scene import Scene
from sim.preview.overhead_map import TopDownMap
from sim.preview.route_map import INK, PAPER, draw_map
from sim.preview.sample_views import look_around
from sim.settings import RecordSettings
from sim.world.world import World, build_world
from vo.contract.arrays import Image

COLUMNS, WIDTH_IN, DPI = 3, 16.8, 120
VIEW_SHARE = 0.6
"""Of a tile's width; the map has the rest."""
GAP_IN, NAME_IN = 0.22, 0.3
CHARACTERS = 33
"""Of a line beside the view."""


@dataclass(frozen=True)
class Tile:
    """What the picture shows of one scene.

    Attributes:
        world: Gives name, path and what the scene tests.
        view: Left eye where there is most to see, (H, W, 3) RGB.
        top_down: From above.
    """

    world: World
    view: Image
    top_down: TopDownMap


def tile(scene: Scene, settings: RecordSettings) -> Tile:
    """Look around in a scene, in colour.

    Raises:
        SettingsError: If the settings do not fit the scene.
        GraphicsError: If there is no GL.
    """
    rig = settings.rig.model_copy(update={"color": True})
    settings = settings.model_copy(update={"rig": rig})
    world = build_world(scene, settings)
    sights = look_around(world, settings)
    return Tile(world, sights.views[sights.shown], sights.top_down)


def overview(tiles: Sequence[Tile]) -> Image:
    """Compose the tiles as (H, 2016, 3) RGB, in rows of COLUMNS."""
    rows = math.ceil(len(tiles) / COLUMNS)
    tile_in = (WIDTH_IN - GAP_IN) / COLUMNS - GAP_IN
    view_in = VIEW_SHARE * tile_in
    tall_in = NAME_IN + 0.75 * view_in + GAP_IN
    height_in = GAP_IN + rows * tall_in
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)

    def axes(left: float, top: float, wide: float, tall: float, anchor: str) -> Axes:
        """Place axes by inches from the upper left corner."""
        box = left / WIDTH_IN, 1 - (top + tall) / height_in, wide / WIDTH_IN, tall / height_in
        return figure.add_axes(box, anchor=anchor)

    def write(left: float, top: float, text: str, **look: Any) -> None:
        figure.text(left / WIDTH_IN, 1 - top / height_in, text, va="top", **look)

    for k, each in enumerate(tiles):
        left = GAP_IN + (k % COLUMNS) * (tile_in + GAP_IN)
        top = GAP_IN + (k // COLUMNS) * tall_in
        write(left, top, each.world.scene.name, fontsize=13, weight="bold", color=INK)
        top += NAME_IN
        view = axes(left, top, view_in, 0.75 * view_in, "NW")
        view.imshow(each.view, interpolation="antialiased")
        view.set_axis_off()
        left += view_in + 0.12
        lines = textwrap.wrap(each.world.scene.tests, CHARACTERS)
        write(left, top - 0.03, "\n".join(lines), fontsize=8.4, color=INK, linespacing=1.3)
        text_in = 0.152 * len(lines) + 0.06
        room = tile_in - view_in - 0.12, 0.75 * view_in - text_in
        chart = axes(left, top + text_in, *room, "SW")
        draw_map(chart, each.world, each.top_down, np.zeros((0, 2)), full=False)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
