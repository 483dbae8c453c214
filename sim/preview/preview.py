"""Pictures of scenes: a contact sheet of views, labels and map of one, and an overview of all."""

import math
import textwrap
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scenes.scene import Scene
from sim.dataset.image_codecs import encode_png
from sim.preview.cameras import TopDownMap
from sim.preview.colours import FAINT, INK, PAPER
from sim.preview.label_plates import draw_labels, show
from sim.preview.route_map import draw_map
from sim.preview.sample_views import CHASE_PX, SampleView, SampleViews, render_sample_views
from sim.settings import RecordSettings
from sim.world.world import START_S, World, build_world
from vo.contract.arrays import Array, Image
from vo.contract.files import known_suffix, replacing
from vo.contract.settings import amended, keys, with_defaults

PICTURES = (".png", ".jpg", ".jpeg")
"""File name suffixes of images."""
JPEG_QUALITY = 85
DPI = 120
COLUMNS, WIDTH_IN = 5, 16.0
STRIP_IN, HEADER_IN, MARGIN_IN = 0.36, 0.72, 0.2
"""Height of the titles above each cell and above the sheet, and width of the sheet's edge."""
SET_LINES = 8
"""Largest number of settings in the list."""
FLAT = 0.42
"""Aspect ratio below which a map leaves room for another image."""
RELIEF_M = 0.02
"""Height difference below which the ground counts as level."""

TILE_COLUMNS, TILES_WIDTH_IN = 3, 16.8
VIEW_SHARE = 0.6
"""Fraction of a tile's width for the view; the rest is for text and map."""
GAP_IN, NAME_IN = 0.22, 0.3
CHARACTERS = 33
"""Length of a line beside the view."""


def preview(scene: Scene, settings: RecordSettings, out: Path) -> None:
    """Write the contact sheet of a scene as the PNG or JPEG `out`."""
    known_suffix(out, PICTURES)
    settings = with_defaults(settings, scene.defaults)
    world = build_world(scene, settings)
    write_picture(out, contact_sheet(world, render_sample_views(world, settings)))


def write_picture(out: Path, image: Image) -> None:
    """Write (H, W, 3) RGB as PNG or JPEG, atomically."""
    if known_suffix(out, PICTURES) == ".png":
        data = encode_png(image)
    else:
        bgr = np.ascontiguousarray(image[..., ::-1])
        data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
    with replacing(out) as partial:
        partial.write_bytes(data)


class _Sheet:
    """A page of figures, placed in inches from its upper left corner."""

    def __init__(self, width_in: float, height_in: float) -> None:
        self._size_in = width_in, height_in
        self._figure = Figure(figsize=self._size_in, dpi=DPI, facecolor=PAPER)

    def axes(self, left: float, top: float, wide: float, tall: float, anchor: str) -> Axes:
        width, height = self._size_in
        box = left / width, (height - top - tall) / height, wide / width, tall / height
        return self._figure.add_axes(box, anchor=anchor)

    def write(self, left: float, top: float, text: str, **style: Any) -> None:
        self._figure.text(left / self._size_in[0], 1 - top / self._size_in[1], text, **style)

    def image(self) -> Image:
        """Draw the page, (H, W, 3) RGB."""
        canvas = FigureCanvasAgg(self._figure)
        canvas.draw()
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


class _Grid(_Sheet):
    """A sheet with rows of COLUMNS cells, each with a strip for its title above."""

    def __init__(self, rows: int, aspect: float) -> None:
        """Size the sheet for images of that height over width."""
        self._column_in = (WIDTH_IN - 2 * MARGIN_IN) / COLUMNS
        self._row_in = self._column_in * min(max(aspect, 0.5), 1.0) + STRIP_IN
        super().__init__(WIDTH_IN, HEADER_IN + rows * self._row_in + MARGIN_IN)

    def cell(self, row: float, column: float, rows: float = 1, columns: float = 1) -> Axes:
        """Add axes over some cells; images start in the upper left corner."""
        left = MARGIN_IN + column * self._column_in
        top = HEADER_IN + row * self._row_in + STRIP_IN
        wide, tall = columns * self._column_in - 0.08, rows * self._row_in - STRIP_IN - 0.03
        return self.axes(left, top, wide, tall, "NW")


def contact_sheet(world: World, samples: SampleViews) -> Image:
    """Compose the sheet, (H, 1920, 3) RGB: views and map above, labels of one instant below."""
    height_px, width_px = samples.best.view.shape[:2]
    grid = _Grid(4, height_px / width_px)
    for k, sample in enumerate(samples.views):
        show(grid.cell(k // 3, k % 3), sample.view, f"{k + 1}", _caption(sample))
    chart = grid.cell(0, 3.1, 1.94, 1.9)
    chart.set_anchor("N")
    positions = np.array([sample.position for sample in samples.views])
    draw_map(chart, world, samples.top_down, positions, full=True)
    _draw_chase(grid, samples)
    best, places = samples.best, ((2, 1), (2, 2), (2, 3), (2, 4), (3, 1), (3, 2), (3, 3))
    draw_labels([grid.cell(*place) for place in places], best.annotation, best.view)
    show(grid.cell(3, 0), best.right, f"at {samples.shown + 1}", "right image")
    _draw_facts(grid.cell(3, 4), world, samples.settings)
    _draw_header(grid, world, samples.settings)
    return grid.image()


def _draw_chase(grid: _Grid, samples: SampleViews) -> None:
    """Show the carrier, large where a flat map leaves room below it."""
    at = f"at {samples.shown + 1}"
    height_px, width_px = samples.top_down.image.shape[:2]
    if height_px > FLAT * width_px:
        show(grid.cell(2, 0), samples.chase, at, "from behind")
        return
    middle = slice(CHASE_PX[1] // 4, -CHASE_PX[1] // 7)
    show(grid.cell(1, 3.1, 1, 1.9), samples.chase[middle], at, "from behind")
    show(grid.cell(2, 0), samples.best.view, at, "left image")


def _draw_header(grid: _Grid, world: World, settings: RecordSettings) -> None:
    grid.write(MARGIN_IN, 0.4, world.scene.name, fontsize=20, weight="bold", color=INK)
    grid.write(MARGIN_IN, 0.66, world.scene.tests, fontsize=11, color=FAINT)
    rig, drive = settings.rig, settings.drive
    route = "own waypoints" if drive.waypoints else drive.route
    facts = (
        f"route {route}, {world.path.length_m:.1f} m at {drive.speed_mps:g} m/s, {drive.carrier}",
        f"{rig.width_px} × {rig.height_px} px at {rig.rate_hz:g} Hz, {rig.hfov_deg:g}° wide, "
        f"baseline {100 * rig.baseline_m:.3g} cm, seed {settings.seed}",
    )
    for top, line in zip((0.4, 0.66), facts, strict=True):
        grid.write(WIDTH_IN - MARGIN_IN, top, line, fontsize=10, color=FAINT, ha="right")


def _caption(sample: SampleView) -> str:
    """Return where a view is from, and its exposure time and gain."""
    exposure, text = sample.exposure, f"{sample.along_m:.1f} m along"
    if exposure.exposure_ms:
        text += f", {exposure.exposure_ms:.3g} ms"
    if exposure.gain > 1:
        text += f", gain {20 * math.log10(exposure.gain):.0f} dB"
    return text


def _draw_facts(axes: Axes, world: World, settings: RecordSettings) -> None:
    """List duration, camera and changed settings; draw the ground's height if it has any."""
    axes.set_axis_off()
    look: dict[str, Any] = {"va": "top", "fontsize": 8, "linespacing": 1.45}
    look["transform"] = axes.transAxes
    axes.text(0.04, 1.0, "\n".join(_summary(world, settings)), color=INK, **look)
    lines = changed_settings(settings)
    if len(lines) > SET_LINES:
        lines = [*lines[: SET_LINES - 1], f"and {len(lines) - SET_LINES + 1} more"]
    if lines:
        axes.text(0.04, 0.72, "\n".join(["set:", *lines]), color=FAINT, **look)
    along_m = np.linspace(0, world.path.length_m, 400)
    height_m = np.asarray(world.scene.elevation(world.path.at(along_m)))
    if float(np.ptp(height_m)) > RELIEF_M:
        _draw_profile(axes.inset_axes((0.1, 0.08, 0.88, 0.24)), along_m, height_m)


def _summary(world: World, settings: RecordSettings) -> list[str]:
    """Return duration, camera pose and exposure."""
    drive, rig, exposure = settings.drive, settings.rig, settings.exposure
    time_s = world.path.length_m / drive.speed_mps
    if world.arrival_s is not None:
        time_s = world.arrival_s - START_S
    elif drive.stop_every_m:
        time_s += drive.stop_s * (world.path.length_m // drive.stop_every_m)
    shutter = f"exposure {exposure.time_ms:g} ms" if exposure.time_ms else "instant exposure"
    if settings.sensor.auto_exposure:
        shutter = f"automatic exposure up to {settings.sensor.exposure_max_ms:g} ms"
    return [
        f"about {time_s:.0f} s, {time_s * rig.rate_hz:.0f} frames",
        f"camera {rig.height_m:g} m up, tilted {rig.tilt_deg:g}° down",
        f"{shutter}, {'colour' if rig.color else 'grey'}",
    ]


def _draw_profile(profile: Axes, along_m: Array, height_m: Array) -> None:
    low, high = float(height_m.min()), float(height_m.max())
    profile.fill_between(along_m, height_m, low - 1, color="#d9d3c6")
    profile.plot(along_m, height_m, color=INK, linewidth=1)
    profile.set_ylim(low - 0.12 * (high - low), high + 0.12 * (high - low))
    profile.set_xlim(0, float(along_m[-1]))
    title = "ground height, m, over path length, m"
    profile.set_title(title, fontsize=7.5, color=FAINT, loc="left", pad=3)
    profile.tick_params(labelsize=6.5, colors=FAINT, length=2, pad=2)
    profile.locator_params(axis="y", nbins=3)
    profile.set_facecolor(PAPER)
    profile.spines[["top", "right"]].set_visible(False)


def changed_settings(settings: RecordSettings) -> list[str]:
    """List the settings that differ from their defaults, as `--set` takes them."""
    default = RecordSettings()
    getters = {key: attrgetter(key) for key in keys(RecordSettings) if key != "scene"}
    values = {key: get(settings) for key, get in getters.items() if get(settings) != get(default)}
    values |= {f"scene.{name}": x for name, x in settings.scene.items()}
    return [f"{key}={_text(value)}" for key, value in values.items()]


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


Tile = tuple[World, Image, TopDownMap]
"""Content of a scene's tile: its world, the left image with the most variety, and its map."""


def tile(scene: Scene, settings: RecordSettings) -> Tile:
    """Render the content of a scene's tile, in colour."""
    settings = amended(with_defaults(settings, scene.defaults), {"rig.color": True})
    world = build_world(scene, settings)
    samples = render_sample_views(world, settings)
    return world, samples.best.view, samples.top_down


def overview(tiles: Sequence[Tile]) -> Image:
    """Compose the tiles as (H, 2016, 3) RGB, in rows of TILE_COLUMNS."""
    rows = math.ceil(len(tiles) / TILE_COLUMNS)
    tile_in = (TILES_WIDTH_IN - GAP_IN) / TILE_COLUMNS - GAP_IN
    view_in = VIEW_SHARE * tile_in
    tall_in = NAME_IN + 0.75 * view_in + GAP_IN
    sheet = _Sheet(TILES_WIDTH_IN, GAP_IN + rows * tall_in)
    for k, (world, image, top_down) in enumerate(tiles):
        left = GAP_IN + (k % TILE_COLUMNS) * (tile_in + GAP_IN)
        top = GAP_IN + (k // TILE_COLUMNS) * tall_in
        sheet.write(left, top, world.scene.name, fontsize=13, weight="bold", color=INK, va="top")
        top += NAME_IN
        view = sheet.axes(left, top, view_in, 0.75 * view_in, "NW")
        view.imshow(image, interpolation="antialiased")
        view.set_axis_off()
        left += view_in + 0.12
        lines = textwrap.wrap(world.scene.tests, CHARACTERS)
        small = {"fontsize": 8.4, "color": INK, "linespacing": 1.3, "va": "top"}
        sheet.write(left, top - 0.03, "\n".join(lines), **small)
        text_in = 0.152 * len(lines) + 0.06
        room = tile_in - view_in - 0.12, 0.75 * view_in - text_in
        chart = sheet.axes(left, top + text_in, *room, "SW")
        draw_map(chart, world, top_down, np.zeros((0, 2)), full=False)
    return sheet.image()
