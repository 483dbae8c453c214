"""A page of figures, placed in inches from its upper left corner."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vo.contract.arrays import Image

INK, FAINT, PAPER = "#2b3036", "#6d747c", "#f5f4f0"
DPI = 120


class Sheet:
    """A figure of a given size in inches."""

    def __init__(self, width_in: float, height_in: float) -> None:
        self._width_in, self._height_in = width_in, height_in
        self._figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self._figure)

    def axes(self, left: float, top: float, wide: float, tall: float, anchor: str) -> Axes:
        """Add axes."""
        low = self._height_in - top - tall
        scale = self._width_in, self._height_in, self._width_in, self._height_in
        box = [x / s for x, s in zip((left, low, wide, tall), scale, strict=True)]
        return self._figure.add_axes((box[0], box[1], box[2], box[3]), anchor=anchor)

    def write(self, left: float, top: float, text: str, **look: Any) -> None:
        """Write text."""
        self._figure.text(left / self._width_in, 1 - top / self._height_in, text, **look)

    def image(self) -> Image:
        """Draw the page, (H, W, 3) RGB."""
        self._canvas.draw()
        return np.ascontiguousarray(np.asarray(self._canvas.buffer_rgba())[..., :3])
