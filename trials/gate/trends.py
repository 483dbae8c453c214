"""Trends of a gate's figures over its history: numbers, rows of a table, and a figure."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from trials.gate.history import CheckRecord
from trials.gate.reports import TITLES
from trials.report.figure import GREEN, GREY, INK, OCHRE, RED, tidy
from vo.contract.arrays import Array

HEADER = ("date", "commit", "verdict", "drift", "change", "lost", "time", "NEES", "scenes")
NOTE = (
    "drift and lost in %; change of drift against the baseline; scenes that regressed; "
    "+ marks uncommitted changes"
)
COLOURS = {"pass": GREEN, "regress": RED, "undecided": OCHRE}
MIN_CHECKS = 5
"""Smallest number of checks of a trend; four in a row rise by chance more often than LEVEL."""
LEVEL = 0.05
MAX_LABELS, MAX_SCENES = 24, 60
COMMIT_LETTERS = 8


@dataclass(frozen=True)
class Trend:
    """Change of a figure over consecutive checks of the same sequences.

    Attributes:
        checks: Number of checks with this figure.
        first: Of the oldest, and `last` of the newest.
        per_check: Median relative change from one check to the next, with its bounds.
        scene: Scene that it is of; empty for all.
    """

    figure: str
    checks: int
    first: float
    last: float
    per_check: float
    low: float
    high: float
    scene: str = ""

    @property
    def direction(self) -> str:
        """`rises` or `falls` if the bounds of the change have one sign, else `level`."""
        return "rises" if self.low > 0 else "falls" if self.high < 0 else "level"

    def __str__(self) -> str:
        of = f" in {self.scene}" if self.scene else ""
        change, low, high = (100 * x for x in (self.per_check, self.low, self.high))
        return (
            f"{TITLES[self.figure]}{of} {self.direction}: {self.first:.3f} to {self.last:.3f} over "
            f"{self.checks} checks, {change:+.2f} % a check ({low:+.2f} to {high:+.2f} %)"
        )


def trend(figure: str, values: Array, level: float = LEVEL, scene: str = "") -> Trend | None:
    """Fit a line to the logarithm of (N,) positive values; NaN is left out.

    Bounds hold but for `level` for independent values. Those of successive commits often are the
    same, so the bounds describe the history; they do not predict it.

    Returns:
        None with so few values, below MIN_CHECKS, that their order alone exceeds the level.

    Source:
        Sen, Estimates of the regression coefficient based on Kendall's tau, JASA 63, 1968.
    """
    at = np.flatnonzero(np.isfinite(values) & (values > 0))
    if 2 / factorial(len(at)) > level:
        return None
    logs = np.log(values[at])
    slope, _, low, high = stats.theilslopes(logs, at, 1 - level)
    ends = (float(x) for x in values[at[[0, -1]]])
    found = (float(np.expm1(x)) for x in (slope, low, high))
    return Trend(figure, len(at), *ends, *found, scene=scene)


def comparable(records: Sequence[CheckRecord]) -> list[CheckRecord]:
    """Return the newest records of the same sequences and estimator as the last one."""
    last = records[-1]
    start = max((k + 1 for k, x in enumerate(records) if x.sequences != last.sequences), default=0)
    return [x for x in records[start:] if x.estimator == last.estimator]


def levels(records: Sequence[CheckRecord], figure: str) -> Array:
    """(N,) levels of the candidate in a figure of N checks; NaN where unknown."""
    found = [x.figures.get(figure) for x in records]
    return np.array([np.nan if x is None or x.now is None else x.now for x in found])


def trends(records: Sequence[CheckRecord]) -> list[Trend]:
    """Return the trend of drift, time and NEES over comparable checks, where there are enough."""
    same = comparable(records)
    found = (trend(x, levels(same, x)) for x in ("drift", "time", "nees"))
    return [x for x in found if x is not None]


def scene_trends(records: Sequence[CheckRecord]) -> list[Trend]:
    """Return the trends of drift in scenes that rise or fall.

    Of scenes without a change, one is named in LEVEL of the histories (Bonferroni).
    """
    same = comparable(records)
    drifts: dict[str, dict[int, float]] = {}
    for k, x in enumerate(same):
        for y in x.scenes:
            if y.drift_percent is not None and y.ratio is not None:
                drifts.setdefault(y.scene, {})[k] = y.drift_percent * y.ratio
    found = [
        trend("drift", np.array([of.get(k, np.nan) for k in range(len(same))]), level, scene)
        for level in [LEVEL / max(1, len(drifts))]
        for scene, of in drifts.items()
    ]
    return [x for x in found if x is not None and x.direction != "level"]


def rows(records: Sequence[CheckRecord]) -> list[tuple[str, ...]]:
    """List cells under HEADER, a row for each check."""
    return [
        (
            f"{x.time:%Y-%m-%d}", commit_label(x), x.verdict, _level(x, "drift"), _change(x),
            _level(x, "losses", 100, 0), _level(x, "time"), _level(x, "nees"),
            ", ".join(x.regressed),
        )
        for x in records
    ]  # fmt: skip


def commit_label(record: CheckRecord) -> str:
    """Shorten a commit; + marks uncommitted changes."""
    return (record.commit[:COMMIT_LETTERS] or "–") + "+" * record.has_changes


def _level(record: CheckRecord, figure: str, scale: float = 1, digits: int = 3) -> str:
    (value,) = levels([record], figure)
    return f"{scale * value:.{digits}f}" if np.isfinite(value) else "–"


def _change(record: CheckRecord) -> str:
    found = record.figures.get("drift")
    return "–" if found is None or found.ratio is None else f"{100 * (found.ratio - 1):+.1f} %"


def figure_size_in(records: Sequence[CheckRecord]) -> tuple[float, float]:
    """Width and height of the figure of a history."""
    return 9.0, 5.0 + 0.2 * len(_scenes(records))


def draw(figure: Figure, records: Sequence[CheckRecord]) -> None:
    """Draw each figure over the checks, marks by verdict, and the change of every scene."""
    scenes = _scenes(records)
    shown = [x for x in TITLES if np.isfinite(levels(records, x)).any()]
    heights = [1.0] * len(shown) + ([0.3 + 0.16 * len(scenes)] if scenes else [])
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    at = np.arange(len(records))
    changed = [k for k in at[1:] if _kind(records[k]) != _kind(records[k - 1])]
    for panel, name in zip(panels[:, 0], shown, strict=False):
        values = levels(records, name) * (100 if name == "losses" else 1)
        verdicts = [x.figures[name].verdict if name in x.figures else "" for x in records]
        for part in np.split(at, changed):
            panel.plot(part, values[part], color=GREY, linewidth=1)
        for verdict, colour in COLOURS.items():
            of = np.array([x == verdict for x in verdicts])
            panel.plot(at[of], values[of], "o", color=colour, markersize=4, label=verdict)
        for k in changed:  # other sequences or estimators have other levels
            panel.axvline(k - 0.5, color=INK, linewidth=0.8, linestyle=":")
        tidy(panel, "", "", TITLES[name])
        top = 1.15 * float(np.nanmax(values)) or 10.0
        panel.set_ylim(-0.05 * top, top)
    if scenes:
        _draw_scenes(figure, panels[-1, 0], records, scenes)
    step = -(-len(records) // MAX_LABELS)
    labels = [commit_label(x) for x in records[::step]]
    panels[-1, 0].set_xticks(at[::step], labels, rotation=60, ha="right")
    handles, names = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncols=3)


def _draw_scenes(
    figure: Figure, panel: Axes, records: Sequence[CheckRecord], scenes: Sequence[str]
) -> None:
    """Draw the change of the drift of each scene in colours; a cross marks those that regressed."""
    percent = np.full((len(scenes), len(records)), np.nan)
    for k, record in enumerate(records):
        for x in record.scenes:
            if x.scene in scenes and x.ratio is not None:
                percent[scenes.index(x.scene), k] = 100 * (x.ratio - 1)
            if x.scene in scenes and x.verdict:
                panel.plot(k, scenes.index(x.scene), "X", markersize=6, mfc="white", mec=INK)
    most = max(10.0, float(np.nanquantile(np.abs(percent), 0.95))) if percent.size else 10.0
    image = panel.imshow(percent, cmap="RdBu_r", vmin=-most, vmax=most, aspect="auto")
    panel.set_yticks(range(len(scenes)), scenes)
    panel.tick_params(labelsize=8)
    panel.set_title("change of drift, %; × regressed")
    figure.colorbar(image, ax=panel, aspect=10)


def _kind(record: CheckRecord) -> tuple[str, str]:
    """What levels depend on beside the commit."""
    return record.sequences, record.estimator


def _scenes(records: Sequence[CheckRecord]) -> list[str]:
    """Scenes in the order in which they appear; those that regressed most often if too many."""
    count = {x.scene: 0 for record in records for x in record.scenes}
    for record in records:
        for name in record.regressed:
            count[name] += 1
    if len(count) > MAX_SCENES:
        return sorted(count, key=lambda x: -count[x])[:MAX_SCENES]
    return [*count]
