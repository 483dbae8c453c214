"""Images and films of a trial: the rover from behind, and both its paths from above."""

import os
import re
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from matplotlib import font_manager
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from sim.preview.cameras import SIDE_DEG, TopDownMap, chase_camera, render_world_map
from sim.preview.film import FILMS, writing
from trials.gym.world.scene_instance import SceneInstance
from vo.contract.arrays import Array, Image, Mask
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix

Colour = tuple[int, int, int]
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
        """Draw the present state as (H, W, 3) RGB, with a caption below.

        The trace (N, 2, 2) is true and estimated x, y, the path (M, 2) leads to the goal, and the
        `covered` cells (H, W) of the free space are brightened.
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

    def _circle(self, canvas: Image, point: Array, radius_px: int, colour: Colour, px: int) -> None:
        centre = self._pixels(point)[0]
        cv2.circle(canvas, centre, radius_px << SHIFT, colour, px, cv2.LINE_AA, SHIFT)

    def _polyline(self, canvas: Image, points: Array, colour: Colour, px: int) -> None:
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


class Filmed(gymnasium.Wrapper[Any, Array, Any, Array], RecordConstructorArgs):
    """Writes one film for each trial, complete when the trial ends or the environment is closed.

    Example:
        >>> import gymnasium
        >>> drawn = {"scene": "yard.xml", "render_mode": "rgb_array", "observe": ("goal",)}
        >>> env = dy.Filmed(gymnasium.make("driftyard/RoverNav-v0", **drawn), "trial.mp4")
        >>> _ = env.reset(seed=3), env.step(env.action_space.sample())
        >>> env.close()
        >>> env.metadata["render_fps"]
        15.0
    """

    def __init__(self, env: gymnasium.Env[Any, Array], out: Path | str) -> None:
        """Film an environment with render_mode rgb_array.

        `out` names the first film, .mp4 or .gif; later ones have `_1`, `_2`, ... before the suffix.
        Raises a SettingsError for another suffix or render_mode.
        """
        RecordConstructorArgs.__init__(self, out=str(out))
        gymnasium.Wrapper.__init__(self, env)
        if env.render_mode != "rgb_array":
            raise SettingsError('a film needs render_mode="rgb_array"')
        self._out, self._trials = Path(out), 0
        known_suffix(self._out, FILMS)
        self._film = ExitStack()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a trial and its film."""
        self._film.close()
        result = self.env.reset(seed=seed, options=options)
        number = f"_{self._trials}" if self._trials else ""
        out = self._out.with_name(f"{self._out.stem}{number}{self._out.suffix}")
        out.parent.mkdir(parents=True, exist_ok=True)
        self._write = self._film.enter_context(writing(out, self.env.metadata["render_fps"]))
        self._trials += 1
        self._write(np.asarray(self.env.render(), np.uint8))
        return result

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Drive on; the film is complete when the trial ends."""
        result = self.env.step(action)
        self._write(np.asarray(self.env.render(), np.uint8))
        if result[2] or result[3]:
            self._film.close()
        return result

    def close(self) -> None:
        """Finish the film."""
        self._film.close()
        super().close()
