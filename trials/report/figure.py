"""How figures for pages and papers look: one palette, quiet axes, units on every label."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vo.contract.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, GREY, PALE = "#2b3036", "#8a9199", "#e6e6e6"
RED, BLUE, OCHRE, GREEN, PURPLE = "#c8401e", "#2a6fb0", "#b5820e", "#3b8754", "#7b5aa6"
SERIES = (RED, BLUE, OCHRE, GREEN, PURPLE, INK)
"""Colours that stay apart for most colour-blind readers, in the order of their use."""
DPI = 130
TRUTH: "Mapping[str, Any]" = {"color": "#c3c9d1", "lw": 4.5, "solid_capstyle": "round", "zorder": 1}
"""A broad, pale line beneath estimates, so that one that lies on it still shows both."""


def save_figure(out: Path, size_in: tuple[float, float], draw: "Callable[[Figure], None]") -> None:
    """Draw a figure and write it as PNG, whole or not at all.

    Args:
        out: File to write.
        size_in: Width and height, inches.
        draw: Fills the empty figure, whose layout is constrained.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure)
    with replacing(out) as partial:
        figure.savefig(partial, format="png", facecolor="white")


def tidy(panel: "Axes", x_label: str, y_label: str, title: str = "") -> None:
    """Label a panel and take away what does not inform."""
    panel.set_xlabel(x_label, fontsize=9)
    panel.set_ylabel(y_label, fontsize=9)
    if title:
        panel.set_title(title, fontsize=9.5, weight="bold", loc="left")
    panel.tick_params(labelsize=8)
    panel.grid(color=PALE, linewidth=0.6)
    panel.set_axisbelow(True)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
