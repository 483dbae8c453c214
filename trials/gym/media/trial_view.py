"""View of a trial: the rover from behind, and its true and estimated paths from above."""

import os
import re
import sys

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from sim.preview.cameras import SIDE_DEG, TopDownMap, chase_camera, render_world_map
from trials.gym.world.scene_instance import SceneInstance
from vo.contract.arrays import Array, Image, Mask

PANEL_PX = 480, 360
CAPTION_PX = 28
TRUE, ESTIMATED, PATH, GOAL = (32, 120, 255), (255, 122, 26), (225, 225, 225), (60, 190, 80)
CAPTION, INK = (38, 40, 44), (236, 236, 232)
"""Colours, RGB."""
SHIFT = 4
"""Fractional bits of the coordinates that OpenCV draws at."""


class TrialView:
    """Draws trials in one instance; the map is rendered once, without the rover's motion."""

    def __init__(self, instance: SceneInstance) -> None:
        self._instance = instance
        world = instance.simulation.world
        world.place_bodies()
        self._map = _fitted(render_world_map(world, instance.camera.renderer), PANEL_PX)
        self._font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 14)

    def draw(self, trace: Array, path: Array, covered: Mask | None, caption: str) -> Image:
        """Draw the present state.

        Args:
            trace: (N, 2, 2) x, y, true and estimated.
            path: (M, 2) waypoints to the goal.
            covered: Cells (H, W) of the free space to brighten.
            caption: Text below.

        Returns:
            (H, W, 3) RGB.
        """
        world, renderer = self._instance.simulation.world, self._instance.camera.renderer
        world.place_bodies()
        chase = renderer.render_view(chase_camera(world, SIDE_DEG), *PANEL_PX)
        panels = np.hstack([chase, self._top_view(trace, path, covered)])
        strip = Pillow.new("RGB", (panels.shape[1], CAPTION_PX), CAPTION)
        draw = ImageDraw.Draw(strip)
        middle = CAPTION_PX / 2
        draw.text((10, middle), caption, fill=INK, font=self._font, anchor="lm")
        right = panels.shape[1] - 10
        for word, colour in (("estimated", ESTIMATED), ("true", TRUE)):
            draw.text((right, middle), word, fill=colour, font=self._font, anchor="rm")
            right -= draw.textlength(word, self._font) + 16
        return np.vstack([panels, np.asarray(strip, np.uint8)])

    def _top_view(self, trace: Array, path: Array, covered: Mask | None) -> Image:
        canvas = self._map.image.copy()
        if covered is not None:
            self._brighten(canvas, covered)
        self._polyline(canvas, path, PATH, 1)
        self._circle(canvas, path[-1:], 7, GOAL, 2)
        self._polyline(canvas, trace[:, 1], ESTIMATED, 2)
        self._polyline(canvas, trace[:, 0], TRUE, 2)
        x, y, yaw = self._instance.simulation.pose2
        arrow = np.array([[x, y], [x + 0.4 * np.cos(yaw), y + 0.4 * np.sin(yaw)]])
        self._circle(canvas, arrow[:1], 5, TRUE, -1)
        self._polyline(canvas, arrow, TRUE, 2)
        self._circle(canvas, trace[-1:, 1], 5, ESTIMATED, 2)
        return canvas

    def _brighten(self, canvas: Image, covered: Mask) -> None:
        space = self._instance.traversable.space
        v, u = np.mgrid[: canvas.shape[0], : canvas.shape[1]]
        x = self._map.x_min_m + (u + 0.5) * self._map.metres_per_px
        y = self._map.y_max_m - (v + 0.5) * self._map.metres_per_px
        cells = space.cells(np.stack([x, y], axis=-1))
        rows, columns = np.moveaxis(np.clip(cells, 0, np.array(covered.shape) - 1), -1, 0)
        seen = space.inside(cells) & covered[rows, columns]
        canvas[seen] = (0.7 * canvas[seen] + 0.3 * np.array(GOAL)).astype(np.uint8)

    def _circle(
        self, canvas: Image, point: Array, radius_px: int, colour: tuple[int, int, int], px: int
    ) -> None:
        centre = self._pixels(point)[0]
        cv2.circle(canvas, centre, radius_px << SHIFT, colour, px, cv2.LINE_AA, SHIFT)

    def _polyline(
        self, canvas: Image, points: Array, colour: tuple[int, int, int], px: int
    ) -> None:
        pixels = [np.array(self._pixels(points))]
        cv2.polylines(canvas, pixels, False, colour, px, cv2.LINE_AA, SHIFT)

    def _pixels(self, points: Array) -> list[tuple[int, int]]:
        """Fixed-point pixels of world points (N, 2)."""
        fixed = np.round(self._map.pixels(points) * (1 << SHIFT)).astype(int)
        return [(int(u), int(v)) for u, v in fixed]


def _fitted(whole: TopDownMap, size_px: tuple[int, int]) -> TopDownMap:
    """Scale a map into a panel, with a border on two sides."""
    height, width = whole.image.shape[:2]
    scale = min(size_px[0] / width, size_px[1] / height)
    inner = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(whole.image, inner, interpolation=cv2.INTER_AREA)
    canvas = np.full((size_px[1], size_px[0], 3), 245, np.uint8)
    left, top = (size_px[0] - inner[0]) // 2, (size_px[1] - inner[1]) // 2
    canvas[top : top + inner[1], left : left + inner[0]] = small
    per_px = whole.metres_per_px * width / inner[0]
    return TopDownMap(canvas, whole.x_min_m - left * per_px, whole.y_max_m + top * per_px, per_px)


def missing_for_window() -> str:
    """Name what a window of OpenCV needs and this machine lacks; empty if nothing."""
    displays = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not any(displays):
        return "there is no display"
    gui = re.search(r"GUI:\s*(\w+)", cv2.getBuildInformation())
    if gui is None or gui[1] == "NONE":
        return "this OpenCV has no windows (pip install opencv-python in its place)"
    return ""
