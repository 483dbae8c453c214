"""True and estimated paths from above, over the map of the scene where the dataset has one."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from trials.evaluation.alignment import Alignment, Pair
from trials.report.charts import Chart, legend_of
from trials.report.figure import GREY, INK, SERIES, Draw, svg_markup
from trials.report.html import data_uri
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError

WIDTH_IN = 8.0
MARGIN = 0.08
"""Margin around the paths, as a fraction of their larger extent."""
MIN_ASPECT = 0.35
"""Height of the drawing over its width; a straight path still gets some ground on either side."""
AXES = ("x", "y", "z", "-x", "-y", "-z")
TITLE = "The path from above"


@dataclass(frozen=True)
class SceneMap:
    """Picture from above (H, W, 3) BGR, x to the right; lowest and highest corner (2, 2)."""

    image: Array
    limits_m: Array

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        jpeg = cv2.imencode(".jpg", self.image, [cv2.IMWRITE_JPEG_QUALITY, 82])[1].tobytes()
        return data_uri(jpeg, "image/jpeg")


def read_scene_map(dataset: Path) -> SceneMap | None:
    """Read the map of a dataset folder, None where the manifest announces none.

    Raises a DatasetError if it cannot be read.
    """
    if not (dataset / MANIFEST).is_file():
        return None
    about = read_manifest(dataset).get("map")
    if about is None:
        return None
    path = dataset / str(about["file"])
    image = cv2.imread(str(path))
    if image is None:
        raise DatasetError(f"{path}: not a readable image")
    width_m, height_m = np.array(image.shape[1::-1]) * float(about["metres_per_px"])
    x, y = float(about["x_min_m"]), float(about["y_max_m"])
    return SceneMap(image, np.array([[x, y - height_m], [x + width_m, y]]))


def ground_axes(T_world_cam: Array) -> Array:
    """Return the world axes (2, 3), right and up, seen from above cameras (N, 4, 4) with y down."""
    down = T_world_cam[:, :3, 1].mean(axis=0)
    vertical = int(np.argmax(np.abs(down)))
    first, second = (vertical + 1) % 3, (vertical + 2) % 3
    # For a vertical axis that points up, first x second = vertical: seen unmirrored.
    return np.eye(3)[[first, second] if down[vertical] < 0 else [second, first]]


def turned(ground: Array) -> Array:
    """Turn a view (2, 3) a quarter clockwise: up becomes right."""
    return np.stack([ground[1], -ground[0]])


def trajectory_drawing(
    T_world_cam: Array, has_z_up: bool, estimates: Mapping[str, Array], background: SceneMap | None
) -> tuple[Draw, tuple[float, float]]:
    """Return how to draw a true path and estimated positions (M, 3) in the world, and the size.

    The poses are (N, 4, 4). With a background, whose place is left transparent, or where it is
    said so, z is up. The size is in inches.
    """
    has_z_up = has_z_up or background is not None
    ground = np.eye(3)[:2] if has_z_up else ground_axes(T_world_cam)
    truth = T_world_cam[:, :3, 3]
    points = np.concatenate([truth, *estimates.values()])
    if background:
        limits_m = background.limits_m
    else:
        extent = np.ptp(points @ ground.T, axis=0)
        ground = turned(ground) if extent[1] > extent[0] else ground
        limits_m = limits_around(points @ ground.T)
    width_m, height_m = limits_m[1] - limits_m[0]

    def draw(figure: Figure) -> None:
        figure.set_layout_engine("none")
        panel = figure.add_axes((0, 0, 1, 1), xlim=limits_m[:, 0], ylim=limits_m[:, 1])
        if background:
            panel.set_axis_off()
        else:
            _draw_ground(panel, ground)
        _draw_path(panel, truth @ ground.T, "white", 6.0)
        drawn = list(zip(estimates.values(), cycle(SERIES)))
        for positions, colour in reversed(drawn):  # the first estimator on top
            _draw_path(panel, positions @ ground.T, colour, 2.5)
        _draw_marks(panel, (truth @ ground.T)[0], limits_m)

    return draw, (WIDTH_IN, WIDTH_IN * height_m / width_m)


def plot_trajectories(
    pair: Pair, estimates: Mapping[str, Array], background: SceneMap | None, alignment: Alignment
) -> Chart:
    """Draw the true path of a pair and estimated positions (M, 3) in the world, aligned."""
    drawing = trajectory_drawing(pair.T_world_cam, not pair.has_attitude, estimates, background)
    draw, size_in = drawing
    svg = svg_markup(TITLE, size_in, draw)
    if background:
        style = f"background: url({background.uri}) 0 0 / 100% 100%"
        svg = svg.replace("<svg ", f'<svg style="{style}" ', 1)
    caption = f"White: the truth. Colours: the estimates, {alignment.words}."
    return Chart(TITLE, svg, (("truth", "white"), *legend_of(estimates)), caption)


def limits_around(points_m: Array) -> Array:
    """Lowest and highest corner (2, 2) around (N, 2) points, not flatter than MIN_ASPECT."""
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    side = max(float((high - low).max()), 0.1)
    half = (high - low) / 2 + MARGIN * side
    half = np.array([max(half[0], half[1]), max(half[1], MIN_ASPECT * half[0])])
    middle = (low + high) / 2
    return np.array([middle - half, middle + half])


def _draw_ground(panel: Axes, ground: Array) -> None:
    panel.grid(color=GREY, linewidth=0.5, alpha=0.5)
    panel.tick_params(length=0, labelleft=False, labelbottom=False)
    panel.spines[:].set_visible(False)
    right, up = (AXES[np.argmax([*axis, *-axis])] for axis in ground)
    panel.annotate(
        f"right: {right}, up: {up}", (1, 1), (-6, -6), "axes fraction", "offset points",
        ha="right", va="top", fontsize=9, color=INK,
    )  # fmt: skip


def _draw_path(panel: Axes, points_m: Array, colour: str, width: float) -> None:
    panel.plot(
        *points_m.T, color=colour, linewidth=width, solid_capstyle="round", **_outlined(width + 1.5)
    )


def _draw_marks(panel: Axes, start_m: Array, limits_m: Array) -> None:
    """Mark the start, and draw a scale bar of a round length in the lower left corner."""
    white: dict[str, Any] = {"color": "white", "weight": "bold", "fontsize": 11, **_outlined(3.0)}
    panel.plot(*start_m, "o", color="white", markeredgecolor="black", markersize=9, gid="start")
    panel.annotate(
        "start", (start_m[0], start_m[1]), (0, 9), textcoords="offset points", ha="center", **white
    )
    width_m = float(limits_m[1, 0] - limits_m[0, 0])
    length_m = float(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0, width_m)[1])
    x, y = limits_m[0] + 0.025 * width_m
    panel.plot([x, x + length_m], [y, y], "|-", color="white", linewidth=2, **_outlined(4.0))
    panel.annotate(f"{length_m:g} m", (x, y), (6, 5), textcoords="offset points", **white)


def _outlined(width: float) -> dict[str, Any]:
    """Return the path effect of a dark outline of a width in points."""
    return {"path_effects": [withStroke(linewidth=width, foreground="#000000")]}
