"""Style of every figure: one palette, light axes, PNG for pages and papers, SVG inside HTML."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo.contract.files import replacing

INK, GREY, PALE = "#2b3036", "#8a9199", "#e6e6e6"
RED, BLUE, OCHRE, GREEN, PURPLE = "#c8401e", "#2a6fb0", "#b5820e", "#327a4a", "#7b5aa6"
TEAL, PINK = "#14808c", "#c2527f"
SERIES = (RED, BLUE, OCHRE, GREEN, PURPLE, INK, TEAL, PINK)
"""Colours of data series in the order of their use; most colour-blind readers can separate them."""
PALETTE = {
    "ink": (INK, "#e8e6e1"),
    "grey": (GREY, "#8f98a3"),
    "rule": (PALE, "#2f353d"),
    "red": (RED, "#ff8a66"),
    "blue": (BLUE, "#6aaeff"),
    "ochre": (OCHRE, "#e2c044"),
    "green": (GREEN, "#7fd08f"),
    "purple": (PURPLE, "#c4a3f0"),
    "teal": (TEAL, "#4fd0c8"),
    "pink": (PINK, "#ff8fb8"),
}
"""CSS custom property to the colour on a light page and on a dark page."""
DPI = 130
TRUTH: Mapping[str, Any] = {"color": "#c3c9d1", "lw": 4.5, "solid_capstyle": "round", "zorder": 1}
"""Style of the true path: a broad, pale line, visible beneath a coinciding estimate."""
STYLE: dict[Any, Any] = {
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": GREY, "xtick.color": GREY,
    "ytick.color": GREY, "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.labelsize": 9,
    "axes.titlesize": 9.5, "axes.titleweight": "bold", "axes.titlelocation": "left",
    "grid.color": PALE, "grid.linewidth": 0.6, "axes.axisbelow": True, "legend.fontsize": 8,
    "legend.title_fontsize": 8, "legend.frameon": False, "svg.fonttype": "none",
    "svg.hashsalt": "driftyard",
}  # fmt: skip
"""Settings of matplotlib for all figures."""

Draw = Callable[[Figure], None]
"""Fills an empty figure, whose layout is constrained."""


def save_figure(out: Path, size_in: tuple[float, float], draw: Draw) -> None:
    """Draw a figure of a width and height in inches, and write it as PNG in one step."""
    with replacing(out) as partial:
        _render(size_in, draw, partial, format="png", facecolor="white")


def svg_markup(title: str, size_in: tuple[float, float], draw: Draw) -> str:
    """Draw a figure as an SVG element for a page whose style sheet defines the PALETTE.

    The title is its accessible name; the element scales with its container, and colours of the
    palette follow the light or dark scheme.
    """
    stream = io.StringIO()
    _render(size_in, draw, stream, format="svg", transparent=True, metadata={"Date": None})
    svg = stream.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style [^>]*>.*?</style>", "", svg, flags=re.DOTALL)  # it would style the page
    svg = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", svg)  # identifiers that every figure repeats
    for colour, _ in PALETTE.values():
        svg = svg.replace(colour, css_colour(colour))
    svg = re.sub(r'^(<svg [^>]*?) width="[^"]*" height="[^"]*"', r"\1", svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(title)}" ', 1)


def css_colour(colour: str) -> str:
    """Return the CSS value of a colour of the PALETTE."""
    (name,) = (name for name, (light, _) in PALETTE.items() if light == colour)
    return f"var(--{name})"


def tidy(panel: Axes, x_label: str, y_label: str, title: str = "") -> None:
    """Label a panel; draw a pale grid and only the left and bottom spines."""
    panel.set(xlabel=x_label, ylabel=y_label, title=title)
    panel.tick_params(labelsize=8)
    panel.grid(True)
    panel.spines[["top", "right"]].set_visible(False)


def grid_of_panels(figure: Figure, count: int, columns: int, **shared: Any) -> list[Axes]:
    """Return `count` panels in rows of at most `columns`."""
    columns = min(columns, count)
    panels = figure.subplots(-(-count // columns), columns, squeeze=False, **shared)
    for panel in panels.flat[count:]:
        panel.set_axis_off()
    return panels.flat[:count].tolist()


def shared_legend(figure: Figure, panels: Sequence[Axes]) -> None:
    """Put the legend of the first panel above all panels."""
    columns = 3 if len(panels) == 1 else 6
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=columns)


def make_figure(size_in: tuple[float, float], draw: Draw) -> Figure:
    """Draw a figure of a width and height in inches."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size_in, dpi=DPI, layout="constrained")
        draw(figure)
    return figure


def _render(size_in: tuple[float, float], draw: Draw, out: Any, **options: Any) -> None:
    with matplotlib.rc_context(STYLE):
        make_figure(size_in, draw).savefig(out, **options)
