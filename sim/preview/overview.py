"""Overview: name, purpose, a view and the map of every scene in one image."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.scene import Scene
from sim.preview.overhead_map import TopDownMap
from sim.preview.route_map import draw_map
from sim.preview.sample_views import render_sample_views
from sim.preview.sheet import INK, Sheet
from sim.settings import RecordSettings
from sim.world.world import World, build_world
from vo.contract.arrays import Image

COLUMNS, WIDTH_IN = 3, 16.8
VIEW_SHARE = 0.6
"""Fraction of a tile's width for the view; the rest is for text and map."""
GAP_IN, NAME_IN = 0.22, 0.3
CHARACTERS = 33
"""Length of a line beside the view."""


@dataclass(frozen=True)
class Tile:
    """Content of a scene's tile: its world, the left image with the most variety, and its map."""

    world: World
    view: Image
    top_down: TopDownMap


def tile(scene: Scene, settings: RecordSettings) -> Tile:
    """Render the content of a scene's tile, in colour."""
    rig = settings.rig.model_copy(update={"color": True})
    settings = settings.model_copy(update={"rig": rig})
    world = build_world(scene, settings)
    samples = render_sample_views(world, settings)
    return Tile(world, samples.best.view, samples.top_down)


def overview(tiles: Sequence[Tile]) -> Image:
    """Compose the tiles as (H, 2016, 3) RGB, in rows of COLUMNS."""
    rows = math.ceil(len(tiles) / COLUMNS)
    tile_in = (WIDTH_IN - GAP_IN) / COLUMNS - GAP_IN
    view_in = VIEW_SHARE * tile_in
    tall_in = NAME_IN + 0.75 * view_in + GAP_IN
    sheet = Sheet(WIDTH_IN, GAP_IN + rows * tall_in)
    for k, each in enumerate(tiles):
        left = GAP_IN + (k % COLUMNS) * (tile_in + GAP_IN)
        top = GAP_IN + (k // COLUMNS) * tall_in
        name = {"fontsize": 13, "weight": "bold", "color": INK, "va": "top"}
        sheet.write(left, top, each.world.scene.name, **name)
        top += NAME_IN
        view = sheet.axes(left, top, view_in, 0.75 * view_in, "NW")
        view.imshow(each.view, interpolation="antialiased")
        view.set_axis_off()
        left += view_in + 0.12
        lines = textwrap.wrap(each.world.scene.tests, CHARACTERS)
        small = {"fontsize": 8.4, "color": INK, "linespacing": 1.3, "va": "top"}
        sheet.write(left, top - 0.03, "\n".join(lines), **small)
        text_in = 0.152 * len(lines) + 0.06
        room = tile_in - view_in - 0.12, 0.75 * view_in - text_in
        chart = sheet.axes(left, top + text_in, *room, "SW")
        draw_map(chart, each.world, each.top_down, np.zeros((0, 2)), full=False)
    return sheet.image()
