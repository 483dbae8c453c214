"""A picture of one moment in a scene through several cameras, side by side."""

from collections.abc import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scenes.scene import Scene
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.preview.colours import INK, PAPER, rgb_of
from sim.preview.sample_views import short_trip
from sim.settings import RecordSettings
from sim.world.world import build_world
from vo.contract.arrays import Image
from vo.contract.settings import with_defaults

SHARE = 1 / 3
"""Where on the route the moment is, as a share of it."""
COLUMNS, WIDTH_IN, DPI = 3, 14.0, 120


def camera_view(scene: Scene, settings: RecordSettings) -> Image:
    """Render the left image (H, W, 3), RGB, of a moment on the route.

    Raises:
        DriveError: If the rover cannot stand there.
        GraphicsError: If there is no OpenGL.
    """
    settings = with_defaults(settings, scene.defaults)
    world = build_world(scene, settings)
    with StereoRenderer(world, settings.render, settings.rig.color) as renderer:
        there, trip = short_trip(world, settings, SHARE)
        camera = StereoCamera(there, settings)
        *_, now, _ = camera.captures(trip, renderer)
        return rgb_of(camera.form_images(now).rectified[0])


def camera_sheet(views: Mapping[str, Image]) -> Image:
    """Compose views by the name of their camera as (H, W, 3) RGB, each with its middle enlarged."""
    columns = min(len(views), COLUMNS)
    rows, width_in = -(-len(views) // columns), WIDTH_IN * columns / COLUMNS
    figure = Figure(figsize=(width_in, rows * 0.62 * WIDTH_IN), dpi=DPI, facecolor=PAPER)
    axes = figure.subplots(2 * rows, columns, squeeze=False)
    for cell in axes.flat:
        cell.set_axis_off()
    for k, (name, view) in enumerate(views.items()):
        row, column = 2 * (k // columns), k % columns
        height, width = view.shape[:2]
        v, u = height // 2 - height // 8, width // 2 - width // 8
        axes[row, column].imshow(view, interpolation="antialiased")
        axes[row, column].set_title(f"{name}, {width} × {height} px", color=INK, loc="left")
        close = view[v : v + height // 4, u : u + width // 4]
        axes[row + 1, column].imshow(close, interpolation="nearest")
    figure.tight_layout(pad=0.6)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
