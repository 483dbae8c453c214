"""Pictures of a trial: the rover from behind, and its true and its estimated path from above."""

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from sim.preview.chase_camera import SIDE_DEG, chase_camera
from sim.preview.overhead_map import TopDownMap, render_world_map
from trials.gym.env.tasks import Explore, Task
from trials.gym.world.scene_instance import Site
from vo.contract.arrays import Array, Image

PANEL_PX = 480, 360
CAPTION_PX = 28
TRUE, BELIEVED, WAY, GOAL = (32, 120, 255), (255, 122, 26), (225, 225, 225), (60, 190, 80)
CAPTION, INK = (38, 40, 44), (236, 236, 232)
SHIFT = 4
"""Binary digits behind the point of what OpenCV draws."""


class Painter:
    """Draws one site; the map is rendered once, without the rover's own motion."""

    def __init__(self, site: Site) -> None:
        self._site = site
        site.simulation.world.place_bodies()
        whole = render_world_map(site.simulation.world, site.eyes.renderer)
        self._map = _fitted(whole, PANEL_PX)
        self._font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 14)

    def paint(self, trace: Array, task: Task, caption: str) -> Image:
        """Draw the present state.

        Args:
            trace: (N, 2, 2) x, y, true and believed.
            task: Gives way and goal.
            caption: What to write below.

        Returns:
            (H, W, 3) RGB.
        """
        site = self._site
        world = site.simulation.world
        world.place_bodies()
        renderer = site.eyes.renderer
        chase = renderer.render_view(chase_camera(world, SIDE_DEG), *PANEL_PX)
        panels = np.hstack([chase, self._from_above(trace, task)])
        strip = Pillow.new("RGB", (panels.shape[1], CAPTION_PX), CAPTION)
        draw = ImageDraw.Draw(strip)
        middle = CAPTION_PX / 2
        draw.text((10, middle), caption, fill=INK, font=self._font, anchor="lm")
        right = panels.shape[1] - 10
        for word, colour in (("estimated", BELIEVED), ("true", TRUE)):
            draw.text((right, middle), word, fill=colour, font=self._font, anchor="rm")
            right -= draw.textlength(word, self._font) + 16
        return np.vstack([panels, np.asarray(strip, np.uint8)])

    def _from_above(self, trace: Array, task: Task) -> Image:
        canvas = self._map.image.copy()
        if isinstance(task, Explore):
            self._tint(canvas, task)
        self._line(canvas, task.way, WAY, 1)
        end = self._pixels(task.way[-1:])[0]
        cv2.circle(canvas, end, 7 << SHIFT, GOAL, 2, cv2.LINE_AA, SHIFT)
        self._line(canvas, trace[:, 1], BELIEVED, 2)
        self._line(canvas, trace[:, 0], TRUE, 2)
        x, y, yaw = self._site.simulation.place
        tip = np.array([[x, y], [x + 0.4 * np.cos(yaw), y + 0.4 * np.sin(yaw)]])
        ends = self._pixels(tip)
        cv2.circle(canvas, ends[0], 5 << SHIFT, TRUE, -1, cv2.LINE_AA, SHIFT)
        cv2.line(canvas, ends[0], ends[1], TRUE, 2, cv2.LINE_AA, SHIFT)
        believed = self._pixels(trace[-1:, 1])[0]
        cv2.circle(canvas, believed, 5 << SHIFT, BELIEVED, 2, cv2.LINE_AA, SHIFT)
        return canvas

    def _tint(self, canvas: Image, task: Explore) -> None:
        """Brighten what was in view."""
        free = self._site.passages.free
        v, u = np.mgrid[: canvas.shape[0], : canvas.shape[1]]
        x = self._map.x_min_m + (u + 0.5) * self._map.metres_per_px
        y = self._map.y_max_m - (v + 0.5) * self._map.metres_per_px
        cells = free.cells(np.stack([x, y], axis=-1))
        rows, columns = np.moveaxis(np.clip(cells, 0, np.array(task.covered.shape) - 1), -1, 0)
        seen = free.inside(cells) & task.covered[rows, columns]
        canvas[seen] = (0.7 * canvas[seen] + 0.3 * np.array(GOAL)).astype(np.uint8)

    def _line(self, canvas: Image, points: Array, colour: tuple[int, int, int], px: int) -> None:
        cv2.polylines(
            canvas, [np.array(self._pixels(points))], False, colour, px, cv2.LINE_AA, SHIFT
        )

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
