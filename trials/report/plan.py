"""True and estimated paths from above, over the scene's map where the dataset has one."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trials.report.svg import COLOURS, Chart, ticks, trace
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError

WIDTH = 720
MARGIN_SHARE = 0.08
LEAST_ASPECT = 0.35
"""Height of the drawing by its width: a straight path still gets some ground beside it."""
AXES = "xyz"


@dataclass(frozen=True)
class Ground:
    """Which two world axes a viewer from above sees, to the right and up.

    Attributes:
        axes: Indices of the two.
        signs: +1 or -1 each.
    """

    axes: tuple[int, int]
    signs: tuple[int, int] = (1, 1)

    @staticmethod
    def below(T_world_cam: Array) -> "Ground":
        """Guess the world's vertical from upright cameras (N, 4, 4): their y axis points down."""
        down = T_world_cam[:, :3, 1].mean(axis=0)
        vertical = int(np.argmax(np.abs(down)))
        first, second = (vertical + 1) % 3, (vertical + 2) % 3
        # For a vertical axis that points up, first x second = vertical: seen unmirrored.
        return Ground((first, second) if down[vertical] < 0 else (second, first))

    def turned(self) -> "Ground":
        """Turn the view a quarter clockwise: up becomes right."""
        return Ground((self.axes[1], self.axes[0]), (self.signs[1], -self.signs[0]))

    def project(self, points_world: Array) -> Array:
        """Map (N, 3) to (N, 2) metres, right and up."""
        return points_world[:, list(self.axes)] * self.signs

    @property
    def labels(self) -> list[str]:
        """Such as `x` and `-z`."""
        return [
            ("-" if sign < 0 else "") + AXES[axis]
            for axis, sign in zip(self.axes, self.signs, strict=True)
        ]


@dataclass(frozen=True)
class View:
    """The rectangle that is drawn, in metres to the right and up."""

    low: Array
    high: Array

    @property
    def scale(self) -> float:
        """Drawing units per metre."""
        return WIDTH / float(self.high[0] - self.low[0])

    @property
    def height(self) -> float:
        """Of the drawing."""
        return float(self.high[1] - self.low[1]) * self.scale

    def place(self, points_m: Array) -> Array:
        """Map (N, 2) metres to drawing units, the second downwards."""
        return (points_m - [self.low[0], self.high[1]]) * [self.scale, -self.scale]

    @staticmethod
    def around(points_m: Array) -> "View":
        """Fit (N, 2) points with a margin, not flatter than LEAST_ASPECT."""
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        side = max(float((high - low).max()), 0.1)
        half = (high - low) / 2 + MARGIN_SHARE * side
        half = np.array([max(half[0], half[1]), max(half[1], LEAST_ASPECT * half[0])])
        middle = (low + high) / 2
        return View(middle - half, middle + half)


@dataclass(frozen=True)
class SceneMap:
    """The picture of the scene from above: x to the right, y up, metres.

    Attributes:
        uri: JPEG as a data URI.
        view: The part of the world that it covers.
    """

    uri: str
    view: View


def read_map(dataset: Path) -> SceneMap | None:
    """Read the map of a dataset folder, None where it has none.

    Raises:
        DatasetError: If the manifest announces a map that cannot be read.
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
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 82])[1].tobytes()
    uri = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
    return SceneMap(uri, View(np.array([x, y - height_m]), np.array([x + width_m, y])))


def plan(T_world_cam: Array, estimates: Mapping[str, Array], background: SceneMap | None) -> Chart:
    """Draw the true path and the estimates, aligned at their first pose.

    Args:
        T_world_cam: (N, 4, 4) truth.
        estimates: Estimator to its positions (M, 3) in the world, metres.
        background: Needs a world with z up.
    """
    ground = Ground((0, 1)) if background else Ground.below(T_world_cam)
    truth = T_world_cam[:, :3, 3]
    points = np.concatenate([truth, *estimates.values()])
    if background:
        view = background.view
    else:
        extent = np.ptp(ground.project(points), axis=0)
        ground = ground.turned() if extent[1] > extent[0] else ground
        view = View.around(ground.project(points))
    parts = [_backdrop(view, background, ground)]
    on_page = view.place(ground.project(truth))
    parts.append(_path(on_page, "truth"))
    for i, positions in reversed(list(enumerate(estimates.values()))):  # the first on top
        parts.append(_path(view.place(ground.project(positions)), f"s{i % COLOURS}"))
    parts.append(_mark(on_page[0], "start"))
    parts.append(_scale_bar(view))
    title = "The drive from above"
    svg = (
        f'<svg viewBox="0 0 {WIDTH} {view.height:.0f}" role="img" aria-label="{title}">'
        f"{''.join(parts)}</svg>"
    )
    legend = tuple((name, i % COLOURS) for i, name in enumerate(estimates))
    caption = "Estimates start at the true first pose; nothing else is fitted. White: the truth."
    return Chart(title, svg, legend, caption)


def _backdrop(view: View, background: SceneMap | None, ground: Ground) -> str:
    if background:
        return f'<image href="{background.uri}" width="{WIDTH}" height="{view.height:.1f}"/>'
    parts = [f'<rect class="ground" width="{WIDTH}" height="{view.height:.1f}"/>']
    for value in ticks(float(view.low[0]), float(view.high[0]), 8):
        x = view.place(np.array([[value, 0.0]]))[0, 0]
        parts.append(f'<path class="grid" d="M{x:.1f} 0V{view.height:.1f}"/>')
    for value in ticks(float(view.low[1]), float(view.high[1]), 4):
        y = view.place(np.array([[0.0, value]]))[0, 1]
        parts.append(f'<path class="grid" d="M0 {y:.1f}H{WIDTH}"/>')
    right, up = ground.labels
    parts.append(f'<text x="{WIDTH - 8}" y="20" text-anchor="end">right: {right}, up: {up}</text>')
    return "".join(parts)


def _path(points: Array, style: str) -> str:
    d = trace(points[:, 0], points[:, 1])
    return f'<path class="halo {style}" d="{d}"/><path class="line {style}" d="{d}"/>'


def _mark(point: Array, label: str) -> str:
    x, y = point
    return (
        f'<circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="6"/>'
        f'<text class="mark" x="{x - 6:.1f}" y="{y - 12:.1f}">{label}</text>'
    )


def _scale_bar(view: View) -> str:
    length_m = float(ticks(0.0, WIDTH / view.scale, 5)[1])
    x, y, end = 16.0, view.height - 16.0, 16.0 + length_m * view.scale
    d = f"M{x} {y - 6:.1f}V{y:.1f}H{end:.1f}V{y - 6:.1f}"
    return (
        f'<path class="halo bar" d="{d}"/><path class="line bar" d="{d}"/>'
        f'<text class="mark" x="{x + 8}" y="{y - 7:.1f}">{length_m:g} m</text>'
    )
