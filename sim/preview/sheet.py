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
    """A page of a given size in inches."""

    def __init__(self, width_in: float, height_in: float) -> None:
        self._size_in = width_in, height_in
        self._figure = Figure(figsize=self._size_in, dpi=DPI, facecolor=PAPER)

    def axes(self, left: float, top: float, wide: float, tall: float, anchor: str) -> Axes:
        """Add axes."""
        width, height = self._size_in
        box = left / width, (height - top - tall) / height, wide / width, tall / height
        return self._figure.add_axes(box, anchor=anchor)

    def write(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write text."""
        self._figure.text(left / self._size_in[0], 1 - top / self._size_in[1], text, **style)

    def image(self) -> Image:
        """Draw the page, (H, W, 3) RGB."""
        canvas = FigureCanvasAgg(self._figure)
        canvas.draw()
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
