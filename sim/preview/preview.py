"""A contact sheet: what the camera will deliver along the route, every label, and the map."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scenes.scene import Scene
from sim.preview.image_file import picture_suffix, write_picture
from sim.preview.label_plates import (
    draw_classes,
    draw_covisibility,
    draw_depth,
    draw_flow,
    draw_normals,
    draw_objects,
    draw_occlusion,
    show,
)
from sim.preview.route_map import FAINT, INK, PAPER, draw_map
from sim.preview.sample_views import CHASE_PX, Sights, Stop, look_around
from sim.settings import RecordSettings
from sim.world.world import START_S, World, build_world
from vo.contract.arrays import Array, Image

COLUMNS, WIDTH_IN, DPI = 5, 16.0, 120
STRIP_IN, HEADER_IN, MARGIN_IN = 0.36, 0.72, 0.2
"""Height of the titles above each plate and above the sheet, and width of the sheet's edge."""
SET_LINES = 8
"""How many settings are listed."""
FLAT = 0.42
"""A map that is flatter than this leaves room for another picture."""
RELIEF_M = 0.02
"""Less difference in height than this is level ground."""


def preview(scene: Scene, settings: RecordSettings, out: Path) -> None:
    """Write the contact sheet of a scene as the PNG or JPEG `out`.

    Raises:
        SettingsError: If the scene has no such route, or `out` names another kind of file.
        GraphicsError: If there is no GL.
    """
    picture_suffix(out)
    world = build_world(scene, settings)
    write_picture(out, contact_sheet(world, look_around(world, settings)))


class _Grid:
    """A figure with rows of COLUMNS cells, each with a strip for its title above."""

    def __init__(self, rows: int, aspect: float) -> None:
        """Size the figure for pictures of that height over width."""
        self._column_in = (WIDTH_IN - 2 * MARGIN_IN) / COLUMNS
        self._row_in = self._column_in * min(max(aspect, 0.5), 1.0) + STRIP_IN
        self.height_in = HEADER_IN + rows * self._row_in + MARGIN_IN
        self.figure = Figure(figsize=(WIDTH_IN, self.height_in), dpi=DPI, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self.figure)

    def cell(self, row: float, column: float, rows: float = 1, columns: float = 1) -> Axes:
        """Add axes over some cells; pictures start in the upper left corner."""
        left = MARGIN_IN + column * self._column_in
        top = HEADER_IN + row * self._row_in + STRIP_IN
        wide, tall = columns * self._column_in - 0.08, rows * self._row_in - STRIP_IN - 0.03
        low = self.height_in - top - tall
        box = left / WIDTH_IN, low / self.height_in, wide / WIDTH_IN, tall / self.height_in
        return self.figure.add_axes(box, anchor="NW")

    def write(self, left_in: float, top_in: float, text: str, **look: Any) -> None:
        """Write into the header, by inches from the upper left corner."""
        self.figure.text(left_in / WIDTH_IN, 1 - top_in / self.height_in, text, **look)

    def image(self) -> Image:
        """Draw it all, (H, W, 3) RGB."""
        self._canvas.draw()
        return np.ascontiguousarray(np.asarray(self._canvas.buffer_rgba())[..., :3])


def contact_sheet(world: World, sights: Sights) -> Image:
    """Compose the sheet, (H, 1920, 3) RGB: views and map above, labels of one instant below."""
    height_px, width_px = sights.views[0].shape[:2]
    grid = _Grid(4, height_px / width_px)
    for k, stop in enumerate(sights.stops):
        show(grid.cell(k // 3, k % 3), stop.view, f"{k + 1}", _told(stop))
    chart = grid.cell(0, 3.1, 1.94, 1.9)
    chart.set_anchor("N")
    stops = np.array([stop.position for stop in sights.stops])
    draw_map(chart, world, sights.top_down, stops, full=True)
    _draw_chase(grid, sights)
    _draw_labels(grid, sights)
    _draw_facts(grid.cell(3, 4), world, sights.settings)
    _draw_header(grid, world, sights.settings)
    return grid.image()


def _draw_chase(grid: _Grid, sights: Sights) -> None:
    """Show the carrier, large where a flat map leaves room below it."""
    at = f"at {sights.shown + 1}"
    height_px, width_px = sights.top_down.image.shape[:2]
    if height_px > FLAT * width_px:
        show(grid.cell(2, 0), sights.chase, at, "from behind")
        return
    middle = slice(CHASE_PX[1] // 4, -CHASE_PX[1] // 7)
    show(grid.cell(1, 3.1, 1, 1.9), sights.chase[middle], at, "from behind")
    show(grid.cell(2, 0), sights.views[sights.shown], at, "left eye")


def _draw_labels(grid: _Grid, sights: Sights) -> None:
    """Show the labels of one instant, beside both eyes."""
    stop = sights.stops[sights.shown]
    annotation = stop.annotation
    draw_depth(grid.cell(2, 1), annotation)
    draw_objects(grid.cell(2, 2), annotation)
    draw_classes(grid.cell(2, 3), annotation)
    draw_normals(grid.cell(2, 4), annotation)
    show(grid.cell(3, 0), stop.right, f"at {sights.shown + 1}", "right eye")
    draw_occlusion(grid.cell(3, 1), annotation, stop.view)
    draw_flow(grid.cell(3, 2), annotation)
    draw_covisibility(grid.cell(3, 3), annotation, stop.view)


def _draw_header(grid: _Grid, world: World, settings: RecordSettings) -> None:
    grid.write(MARGIN_IN, 0.4, world.scene.name, fontsize=20, weight="bold", color=INK)
    grid.write(MARGIN_IN, 0.66, world.scene.tests, fontsize=11, color=FAINT)
    for k, line in enumerate(_facts(world, settings)):
        right = WIDTH_IN - MARGIN_IN
        grid.write(right, 0.4 + 0.26 * k, line, fontsize=10, color=FAINT, ha="right")


def _facts(world: World, settings: RecordSettings) -> tuple[str, str]:
    rig, drive = settings.rig, settings.drive
    route = "own waypoints" if drive.waypoints else drive.route
    way = f"route {route}, {world.path.length_m:.1f} m at {drive.speed_mps:g} m/s, {drive.carrier}"
    camera = (
        f"{rig.width_px} × {rig.height_px} px at {rig.rate_hz:g} Hz, {rig.hfov_deg:g}° wide, "
        f"baseline {100 * rig.baseline_m:.3g} cm, seed {settings.seed}"
    )
    return way, camera


def _told(stop: Stop) -> str:
    """Say where a view is from and how it was exposed, if not in an instant."""
    words = [f"{stop.along_m:.1f} m along"]
    exposure = stop.exposure
    if exposure.exposure_ms:
        words.append(f"{exposure.exposure_ms:.3g} ms")
    if exposure.gain > 1:
        words.append(f"gain {20 * math.log10(exposure.gain):.0f} dB")
    return ", ".join(words)


def _draw_facts(axes: Axes, world: World, settings: RecordSettings) -> None:
    """List what to expect and what was set; draw the ground's height if it has any."""
    axes.set_axis_off()
    above: dict[str, Any] = {
        "transform": axes.transAxes,
        "va": "top",
        "fontsize": 8,
        "linespacing": 1.45,
    }
    axes.text(0.04, 1.0, "\n".join(_expected(world, settings)), color=INK, **above)
    lines = chosen(settings)
    if len(lines) > SET_LINES:
        lines = [*lines[: SET_LINES - 1], f"and {len(lines) - SET_LINES + 1} more"]
    if lines:
        axes.text(0.04, 0.72, "\n".join(["set:", *lines]), color=FAINT, **above)
    along_m = np.linspace(0, world.path.length_m, 400)
    height_m = np.asarray(world.scene.elevation(world.path.at(along_m)))
    if float(np.ptp(height_m)) > RELIEF_M:
        _draw_profile(axes.inset_axes((0.1, 0.08, 0.88, 0.24)), along_m, height_m)


def _expected(world: World, settings: RecordSettings) -> list[str]:
    """Say how much there will be to record, and how the camera looks."""
    drive, rig, exposure = settings.drive, settings.rig, settings.exposure
    time_s = world.path.length_m / drive.speed_mps
    if world.arrival_s is not None:
        time_s = world.arrival_s - START_S
    elif drive.stop_every_m:
        time_s += drive.stop_s * (world.path.length_m // drive.stop_every_m)
    shutter = f"shutter {exposure.time_ms:g} ms" if exposure.time_ms else "shutter of an instant"
    if settings.sensor.auto_exposure:
        shutter = f"automatic shutter up to {settings.sensor.exposure_max_ms:g} ms"
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
    title = "height of the ground, m, over the way, m"
    profile.set_title(title, fontsize=7.5, color=FAINT, loc="left", pad=3)
    profile.tick_params(labelsize=6.5, colors=FAINT, length=2, pad=2)
    profile.locator_params(axis="y", nbins=3)
    profile.set_facecolor(PAPER)
    for side in ("top", "right"):
        profile.spines[side].set_visible(False)


def chosen(settings: RecordSettings) -> list[str]:
    """List what differs from the default settings, as `--set` takes it."""
    return list(_differences(settings.model_dump(), RecordSettings().model_dump(), ""))


def _differences(mine: Mapping[str, Any], plain: Mapping[str, Any], prefix: str) -> Iterator[str]:
    for key, value in mine.items():
        default = plain.get(key)
        if isinstance(value, Mapping):
            below = default if isinstance(default, Mapping) else {}
            yield from _differences(value, below, f"{prefix}{key}.")
        elif value != default:
            shown = str(value).lower() if isinstance(value, bool) else value
            yield (
                f"{prefix}{key}={shown:g}" if isinstance(shown, float) else f"{prefix}{key}={shown}"
            )
