"""Charts of a run report."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, groupby

import numpy as np
from matplotlib.axes import Axes

from trials.evaluation.alignment import Alignment, Pair
from trials.evaluation.metrics import position_errors
from trials.evaluation.runs import FrameTable
from trials.evaluation.score import Score
from trials.report.figure import GREY, OCHRE, RED, SERIES, css_colour, svg_markup, tidy
from vo.contract.arrays import Array
from vo.contract.estimator import Status
from vo.contract.trajectory import NS_PER_S

SIZE_IN = (4.2, 2.4)
MAX_POINTS = 600
"""Points of a curve; longer curves are averaged."""
SHADES = {Status.START: GREY, Status.WEAK: OCHRE, Status.LOST: RED}
"""Status to the colour behind frames that have it."""

Curves = Mapping[str, tuple[Array, Array]]
"""Name to (N,) x and (N,) y."""


@dataclass(frozen=True)
class Chart:
    """A drawing as SVG, with its heading, its caption, and label and CSS colour of each series."""

    title: str
    svg: str
    legend: tuple[tuple[str, str], ...]
    caption: str


def error_over_distance(pairs: Mapping[str, Pair], alignment: Alignment) -> Chart:
    """Position error of each estimator, aligned, over the true path."""
    curves = {
        name: (pair.travelled_m, 100 * position_errors(pair, alignment))
        for name, pair in pairs.items()
    }
    caption = f"Distance between estimated and true position, {alignment.words}."
    return _line_chart("Error over distance", caption, curves, "true path, m", "position error, cm")


def drift_by_length(scores: Sequence[Score]) -> Chart:
    """Mean drift of the segments of every length."""
    curves = {
        score.estimator: (
            np.array([x.length_m for x in score.segments]),
            np.array([x.mean_percent for x in score.segments]),
        )
        for score in scores
    }
    caption = (
        "Mean translation error of all segments of a length, divided by that length. A flat curve "
        "indicates an error of scale; a falling curve, frame errors that average out; a rising "
        "curve, rotation errors that accumulate."
    )
    return _line_chart("Drift by segment length", caption, curves, "segment length, m", "drift, %")


def stage_counts(frames: FrameTable) -> Chart:
    """Items that pass each stage over time; frames that are not `tracked` are shaded."""
    time_s = _time_s(frames)
    curves = {
        stage: (time_s, counts)
        for stage, counts in frames.counts.items()
        if not stage.endswith("iterations")  # a count of an optimiser, not of items
    }
    caption = "Shaded frames are not tracked normally: grey start, ochre weak, red lost."
    return _line_chart(
        "Items after each stage", caption, curves, "time, s", "items per frame",
        lambda panel: _shade(panel, frames, time_s),
    )  # fmt: skip


def stage_timings(frames: FrameTable) -> Chart:
    """Stacked milliseconds of the stages over time; a stage that did not run counts as 0."""
    layers = [downsample(_time_s(frames), np.nan_to_num(y)) for y in frames.timings_ms.values()]

    def draw(panel: Axes) -> None:
        heights = np.array([y for _, y in layers])
        panel.stackplot(layers[0][0], heights, colors=SERIES)
        # One slow frame, such as a compilation at the start, must not set the scale.
        top = 1.25 * float(np.percentile(heights.sum(axis=0), 98))
        panel.set_ylim(0, top if top > 0 else 1.0)
        panel.margins(x=0)
        tidy(panel, "time, s", "ms per frame")

    caption = "Wall time of the estimator without the loading of images."
    return _chart("Time per stage", caption, frames.timings_ms, draw)


def downsample(x: Array, y: Array) -> tuple[Array, Array]:
    """Average (N,) curves to at most MAX_POINTS points; a bin of only NaN is NaN."""
    if len(x) <= MAX_POINTS:
        return x, y
    cuts = np.linspace(0, len(x), MAX_POINTS + 1).astype(int)[:-1]
    known = np.add.reduceat(np.isfinite(y).astype(float), cuts)
    total = np.add.reduceat(np.nan_to_num(y), cuts)
    mean = np.divide(total, known, out=np.full(len(cuts), np.nan), where=known > 0)
    return np.add.reduceat(x, cuts) / np.diff([*cuts, len(x)]), mean


def legend_of(names: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Return each name with the CSS colour of its series."""
    return tuple((name, css_colour(colour)) for name, colour in zip(names, cycle(SERIES)))


def _chart(title: str, caption: str, names: Iterable[str], draw: Callable[[Axes], None]) -> Chart:
    svg = svg_markup(title, SIZE_IN, lambda figure: draw(figure.subplots()))
    return Chart(title, svg, legend_of(names), caption)


def _line_chart(
    title: str, caption: str, curves: Curves, x_label: str, y_label: str,
    draw_background: Callable[[Axes], None] = lambda panel: None,
) -> Chart:  # fmt: skip
    """Draw curves from zero upwards, broken at NaN; a point without neighbours is a dot."""

    def draw(panel: Axes) -> None:
        draw_background(panel)
        for colour, curve in zip(cycle(SERIES), curves.values()):
            x, y = downsample(*curve)
            known = np.pad(np.isfinite(y), 1)
            dots = np.flatnonzero(known[1:-1] & ~known[:-2] & ~known[2:]).tolist()
            panel.plot(x, y, color=colour, linewidth=1.3, marker=".", markevery=dots)
        panel.margins(x=0.02)
        panel.set(xlim=(0, None), ylim=(0, None))
        tidy(panel, x_label, y_label)

    return _chart(title, caption, curves, draw)


def _time_s(frames: FrameTable) -> Array:
    return (frames.timestamps_ns - frames.timestamps_ns[0]) / NS_PER_S


def _shade(panel: Axes, frames: FrameTable, time_s: Array) -> None:
    """Shade runs of frames by status; a frame lasts until the next one."""
    ends = np.append(time_s[1:], time_s[-1])
    for status, group in groupby(range(len(frames)), key=lambda i: frames.status[i]):
        rows = list(group)
        if status in SHADES:
            band = panel.axvspan(time_s[rows[0]], ends[rows[-1]], color=SHADES[status], alpha=0.3)
            band.set_gid(f"{status.value}-from-{rows[0]}")
