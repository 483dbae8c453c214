"""A contact sheet: what the camera will deliver along the route, every label, and the map."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scenes.scene import Scene
from sim.chart import FAINT, INK, PAPER, draw_map
from sim.picture import picture_suffix, write_picture
from sim.plates import (
    draw_classes,
    draw_covisibility,
    draw_depth,
    draw_flow,
    draw_normals,
    draw_objects,
    draw_occlusion,
    show,
)
from sim.settings import RecordSettings
from sim.sights import Sights, Stop, look_around
from sim.world import START_S, World, build_world
from vo.contract.arrays import Array, Image

COLUMNS, WIDTH_IN, DPI = 5, 16.0, 120
STRIP_IN, HEADER_IN, MARGIN_IN = 0.36, 0.72, 0.2
"""Height of the titles above each plate and above the sheet, and width of the sheet's edge."""
SET_LINES = 8
"""How many settings are listed."""
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


def contact_sheet(world: World, sights: Sights) -> Image:
    """Compose the sheet, (H, 1920, 3) RGB: views and map above, labels of one instant below."""
    height_px, width_px = sights.views[0].shape[:2]
    column_in = (WIDTH_IN - 2 * MARGIN_IN) / COLUMNS
    row_in = column_in * min(max(height_px / width_px, 0.5), 1.0) + STRIP_IN
    height_in = HEADER_IN + 4 * row_in + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)

    def cell(row: float, column: float, rows: float = 1, columns: float = 1) -> Axes:
        """Place axes on the grid, below the strip for their title."""
        left = MARGIN_IN + column * column_in
        top = height_in - HEADER_IN - row * row_in - STRIP_IN
        wide, tall = columns * column_in - 0.08, rows * row_in - STRIP_IN - 0.03
        box = (left / WIDTH_IN, (top - tall) / height_in, wide / WIDTH_IN, tall / height_in)
        return figure.add_axes(box, anchor="NW")

    for k, stop in enumerate(sights.stops):
        show(cell(k // 3, k % 3), stop.view, f"{k + 1}", _told(stop))
    chart = cell(0, 3.1, 1.94, 1.9)
    chart.set_anchor("N")
    stops = np.array([stop.position for stop in sights.stops])
    draw_map(chart, world, sights.top_down, stops, full=True)
    _draw_labels(cell, sights)
    _draw_facts(cell(3, 4), world, sights.settings)
    _draw_header(figure, world, sights, height_in)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


class _Cell(Protocol):
    """Gives axes by row and column."""

    def __call__(self, row: float, column: float, rows: float = 1, columns: float = 1) -> Axes: ...


def _draw_labels(cell: _Cell, sights: Sights) -> None:
    """Show one instant: both eyes are above and left, every label beside."""
    stop, at = sights.stops[sights.shown], f"at {sights.shown + 1}"
    annotation = stop.annotation
    show(cell(2, 0), sights.chase, at, "from behind")
    draw_depth(cell(2, 1), annotation)
    draw_objects(cell(2, 2), annotation)
    draw_classes(cell(2, 3), annotation)
    draw_normals(cell(2, 4), annotation)
    show(cell(3, 0), stop.right, at, "right eye")
    draw_occlusion(cell(3, 1), annotation, stop.view)
    draw_flow(cell(3, 2), annotation)
    draw_covisibility(cell(3, 3), annotation, stop.view)


def _draw_header(figure: Figure, world: World, sights: Sights, height_in: float) -> None:
    left = MARGIN_IN / WIDTH_IN
    name = world.scene.name
    figure.text(left, 1 - 0.4 / height_in, name, fontsize=20, weight="bold", color=INK)
    figure.text(left, 1 - 0.66 / height_in, world.scene.tests, fontsize=11, color=FAINT)
    right: dict[str, Any] = {"color": FAINT, "ha": "right"}
    facts = _facts(world, sights.settings)
    for k, line in enumerate(facts):
        figure.text(1 - left, 1 - (0.4 + 0.26 * k) / height_in, line, fontsize=10, **right)


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
    shot = stop.shot
    if shot.exposure_ms:
        words.append(f"{shot.exposure_ms:.3g} ms")
    if shot.gain > 1:
        words.append(f"gain {20 * math.log10(shot.gain):.0f} dB")
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
