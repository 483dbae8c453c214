"""The comparison of recordings as one HTML page, with pictures and a chart of each quantity."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes

from trials.realism.comparison import Comparison
from trials.realism.quantities import QUANTITIES, Measured
from trials.report.charts import Chart, legend_of
from trials.report.figure import BLUE, RED, svg_markup, tidy
from trials.report.html import data_uri, write_html

SIZE_IN = (4.2, 2.2)
SHOWN = 0.995
"""Share of each histogram that its chart shows."""
POINTS = 80
"""Largest number of bars of a histogram."""
METHOD = (
    "Distances of histograms are Wasserstein-1 over the standard deviation of the real recording: "
    "1 means that values are shifted by one standard deviation. Distances of curves and means are "
    "the mean absolute logarithm of the ratio: 0.1 is about 10 %. That of vignetting is the "
    "difference in the share of light that the corner loses. 0 is equality.",
    "Errors are standard errors by a bootstrap over blocks of successive frames of both "
    "recordings. By chance is the median distance of the real recording to itself, its frames "
    "drawn anew: a distance of that size says nothing.",
    "Nothing needs a ground truth. Matches, tracks and disparities are those of this project's "
    "estimator. Both recordings are used with the same number of frames; track lengths, matches in "
    "time and image motion also depend on frame rate and speed.",
)


def write_page(comparison: Comparison, out: Path) -> None:
    """Write the page.

    Raises:
        DatasetError: If it cannot be written.
    """
    both = (("real", comparison.real), ("simulated", comparison.simulated))
    charts = [
        _chart(comparison, name) for name in QUANTITIES
        if QUANTITIES[name].axis and comparison.distances[name].value is not None
    ]  # fmt: skip
    write_html(
        out,
        "realism.html.j2",
        title=f"{comparison.simulated.name} beside {comparison.real.name}",
        subtitle="; ".join(f"{kind}: {x.name}, {x.frames} frames" for kind, x in both),
        pictures=[(kind, [_picture(image) for image in x.pictures]) for kind, x in both],
        table=comparison.table(),
        charts=charts,
        method=METHOD,
    )


def _chart(comparison: Comparison, name: str) -> Chart:
    quantity = QUANTITIES[name]
    both = {"real": comparison.real, "simulated": comparison.simulated}

    def draw(panel: Axes) -> None:
        for colour, x in zip((RED, BLUE), both.values(), strict=True):
            _draw(panel, name, x, colour)
        if quantity.kind == "histogram":
            panel.set_xlim(quantity.x[0], _limit(name, list(both.values())))
            panel.set_ylim(0)
        else:
            panel.set_yscale("log")
        tidy(panel, quantity.axis, "density" if quantity.kind == "histogram" else quantity.label)

    svg = svg_markup(quantity.label, SIZE_IN, lambda figure: draw(figure.subplots()))
    return Chart(quantity.label, svg, legend_of(both), comparison.distances[name].text)


def _draw(panel: Axes, name: str, measured: Measured, colour: str) -> None:
    quantity, found = QUANTITIES[name], measured.estimate(name)
    assert found is not None  # a distance has both estimates
    if quantity.kind != "histogram":
        panel.plot(quantity.x, found, color=colour, linewidth=1.3, marker=".", markersize=4)
        return
    limit = np.searchsorted(quantity.x, _limit(name, [measured]))
    size = max(1, int(limit) // POINTS)
    count = len(found) // size * size
    width = size * (quantity.x[1] - quantity.x[0])
    density = found[:count].reshape(-1, size).sum(axis=1) / width
    panel.stairs(
        density, quantity.x[0] - (quantity.x[1] - quantity.x[0]) / 2
        + width * np.arange(len(density) + 1), color=colour, linewidth=1.3,
    )  # fmt: skip


def _limit(name: str, several: list[Measured]) -> float:
    """Return the value below which the shown share of histograms lies."""
    x = QUANTITIES[name].x
    found = (m.estimate(name) for m in several)
    last = max(int(np.searchsorted(np.cumsum(h), SHOWN)) for h in found if h is not None)
    return float(x[min(last + 1, len(x) - 1)])


def _picture(image: np.ndarray) -> str:
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return data_uri(jpeg, "image/jpeg")
