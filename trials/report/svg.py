"""Charts as inline SVG: coloured by the page's style sheet, so that they follow light and dark."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from vo.contract.arrays import Array

WIDTH, HEIGHT = 480, 270
"""Size of a chart in its own units; text is 13 of them, legible at the width of a phone."""
LEFT, RIGHT, TOP, BOTTOM = 60, 12, 12, 44
COLOURS = 8
"""Number of series colours that the style sheet defines."""
MOST_POINTS = 600


@dataclass(frozen=True)
class Chart:
    """A drawing with what stands around it.

    Attributes:
        title: Heading.
        svg: Markup.
        legend: (label, index of colour) in the order drawn.
        caption: What to see, and how it is defined.
    """

    title: str
    svg: str
    legend: tuple[tuple[str, int], ...] = ()
    caption: str = ""


@dataclass(frozen=True)
class Axes:
    """Two linear scales from data to drawing units, y upwards.

    Attributes:
        x: Range of the data.
        y: Range of the data.
        width: Of the drawing.
        height: Of the drawing.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    width: float = WIDTH
    height: float = HEIGHT

    def px(self, x: Array | float) -> Array:
        """Data to drawing units along x."""
        share = (np.asarray(x, dtype=float) - self.x[0]) / (self.x[1] - self.x[0])
        return LEFT + share * (self.width - LEFT - RIGHT)

    def py(self, y: Array | float) -> Array:
        """Data to drawing units along y."""
        share = (np.asarray(y, dtype=float) - self.y[0]) / (self.y[1] - self.y[0])
        return self.height - BOTTOM - share * (self.height - TOP - BOTTOM)

    def grid(self, x_label: str, y_label: str) -> str:
        """Grid lines, numbers and labels."""
        left, right = LEFT, self.width - RIGHT
        top, bottom = TOP, self.height - BOTTOM
        parts: list[str] = []
        for value in ticks(*self.y):
            y = float(self.py(value))
            parts.append(f'<path class="grid" d="M{left} {y:.1f}H{right}"/>')
            parts.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
        for value in ticks(*self.x):
            x = float(self.px(value))
            parts.append(f'<path class="grid" d="M{x:.1f} {top}V{bottom}"/>')
            parts.append(
                f'<text x="{x:.1f}" y="{bottom + 17}" text-anchor="middle">{value:g}</text>'
            )
        middle = (left + right) / 2
        parts.append(
            f'<text x="{middle:.1f}" y="{self.height - 6}" text-anchor="middle">'
            f"{escape(x_label)}</text>"
        )
        parts.append(
            f'<text class="label" transform="translate(12 {(top + bottom) / 2:.1f}) rotate(-90)" '
            f'text-anchor="middle">{escape(y_label)}</text>'
        )
        return "".join(parts)

    def line(self, x: Array, y: Array, style: str) -> str:
        """A polyline through (N,) points, broken where y is NaN."""
        return f'<path class="line {style}" d="{trace(self.px(x), self.py(y))}"/>'

    def band(self, x: tuple[float, float], style: str) -> str:
        """Shade a stretch of x over the whole height, at least one unit wide."""
        start, end = (float(v) for v in self.px(np.array(x)))
        width, height = max(end - start, 1.0), self.height - TOP - BOTTOM
        return (
            f'<rect class="{style}" x="{start:.1f}" y="{TOP}" width="{width:.1f}" '
            f'height="{height}"/>'
        )

    def area(self, x: Array, lower: Array, upper: Array, style: str) -> str:
        """Fill between two curves."""
        there = trace(self.px(x), self.py(upper))
        back = trace(self.px(x[::-1]), self.py(lower[::-1])).replace("M", "L", 1)
        return f'<path class="{style}" d="{there}{back}Z"/>'


@dataclass(frozen=True)
class Bands:
    """Stretches of x to shade.

    Attributes:
        stretches: Style to its (start, end) pairs.
    """

    stretches: Mapping[str, Sequence[tuple[float, float]]] = field(
        default_factory=dict[str, Sequence[tuple[float, float]]]
    )


def line_chart(
    title: str,
    series: Mapping[str, tuple[Array, Array]],
    x_label: str,
    y_label: str,
    bands: Bands | None = None,
    caption: str = "",
) -> Chart:
    """Draw (N,) x and y of every series from zero upwards."""
    axes = Axes(_range([x for x, _ in series.values()]), _range([y for _, y in series.values()]))
    parts = [axes.grid(x_label, y_label)]
    for style, stretches in (bands or Bands()).stretches.items():
        parts += [axes.band(stretch, style) for stretch in stretches]
    for i, (x, y) in enumerate(series.values()):
        parts.append(axes.line(*thin(x, y), style=f"s{i % COLOURS}"))
    return Chart(title, drawing("".join(parts), axes, title), _legend(series), caption)


def stacked_chart(
    title: str,
    x: Array,
    layers: Mapping[str, Array],
    x_label: str,
    y_label: str,
    caption: str = "",
) -> Chart:
    """Stack (N,) layers over (N,) x, the first at the bottom; NaN counts as 0."""
    names, columns = list(layers), [thin(x, np.nan_to_num(y)) for y in layers.values()]
    x = columns[0][0]
    edges = np.vstack([np.zeros(len(x)), np.cumsum([y for _, y in columns], axis=0)])
    # A single slow frame (compilation at the start) must not flatten all the others.
    top = 1.25 * float(np.percentile(edges[-1], 98))
    axes = Axes(_range([x]), (0.0, top if top > 0 else 1.0))
    areas = [
        axes.area(x, edges[i].clip(max=top), edges[i + 1].clip(max=top), f"f{i % COLOURS}")
        for i in range(len(names))
    ]
    svg = drawing("".join([*areas, axes.grid(x_label, y_label)]), axes, title)
    return Chart(title, svg, _legend(layers), caption)


def drawing(content: str, axes: Axes, title: str) -> str:
    """Wrap content as an SVG that scales with its container."""
    return (
        f'<svg viewBox="0 0 {axes.width:.0f} {axes.height:.0f}" role="img" '
        f'aria-label="{escape(title)}">{content}</svg>'
    )


def trace(x: Array, y: Array) -> str:
    """Path data through points in drawing units, broken where one is not finite."""
    commands: list[str] = []
    pen_down = False
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not (np.isfinite(a) and np.isfinite(b)):
            pen_down = False
            continue
        # A stroke of no length makes a lone point a dot.
        commands.append(f"L{a:.1f} {b:.1f}" if pen_down else f"M{a:.1f} {b:.1f}h0")
        pen_down = True
    return "".join(commands)


def ticks(low: float, high: float, count: int = 5) -> Array:
    """Round numbers (1, 2 or 5 times a power of ten) within a range, about `count` of them."""
    raw = (high - low) / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(m for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return np.round(np.arange(first, last + 1) * step, 12) + 0.0  # no -0


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Average (N,) curves to at most MOST_POINTS points; a bin is NaN where it holds only NaN."""
    if len(x) <= MOST_POINTS:
        return x, y
    cuts = np.linspace(0, len(x), MOST_POINTS + 1).astype(int)[:-1]
    known = np.add.reduceat(np.isfinite(y).astype(float), cuts)
    total = np.add.reduceat(np.nan_to_num(y), cuts)
    mean = np.divide(total, known, out=np.full(len(cuts), np.nan), where=known > 0)
    return np.add.reduceat(x, cuts) / np.diff([*cuts, len(x)]), mean


def _range(curves: Sequence[Array]) -> tuple[float, float]:
    """From zero (or below) to the largest finite value, never empty."""
    values = np.concatenate([np.asarray(c, dtype=float) for c in curves] or [np.zeros(1)])
    values = values[np.isfinite(values)]
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    return low, high + 0.05 * (high - low) if high > low else low + 1.0


def _legend(series: Mapping[str, object]) -> tuple[tuple[str, int], ...]:
    return tuple((name, i % COLOURS) for i, name in enumerate(series))
