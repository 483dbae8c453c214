"""Drift of the default settings on scenes that no parameter has seen; `driftyard accuracy`.

Every scene is driven with seeds 0, 1, ...; parameters were chosen on seeds of 100 and above, so
that no figure here is of a drive that a parameter has seen. A drive is one sample: the figures
are medians over drives, with the worst drive and a bootstrap interval over drives.
"""

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from trials.estimators.choice import COMPARED
from trials.execution.jobs import Result, Variant
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.files import write_text

SCENES = "brick_court,office"
"""Scenes by default; all of them take hours."""
VARIANTS = tuple(Variant(name, name) for name in COMPARED)
RESAMPLES, CONFIDENCE = 10_000, 0.95


@dataclass(frozen=True)
class Figure:
    """A row of the table.

    Attributes:
        label: With the unit.
        key: Path into a score's JSON.
        digits: To print.
    """

    label: str
    key: tuple[str, ...]
    digits: int


FIGURES = (
    Figure("drift over 1 m, median, %", ("drift_1m", "median_percent"), 3),
    Figure("drift over 1 m, mean, %", ("drift_1m", "mean_percent"), 3),
    Figure("rotation over 1 m, °/m", ("drift_1m", "mean_deg_per_m"), 4),
    Figure("end point, % of path", ("end_percent",), 3),
    Figure("ms per frame, median, all cores busy", ("frame_ms",), 1),
)


def named_variant(words: str) -> Variant:
    """Read an estimator and its settings, separated as a shell does.

    A class goes by its name; ours, which stand in the tables already, by all the words.

    Raises:
        SettingsError: If a quotation does not end.
    """
    try:
        name, *overrides = shlex.split(words) or [""]
    except ValueError as error:
        raise SettingsError(f"--against {words}: {error}") from None
    return Variant(name.rpartition(":")[2] if ":" in name else words, name, tuple(overrides))


def summary_tables(runs: Mapping[str, Sequence[Result]]) -> list[Table]:
    """Lay out our drift over 1 m beside every other estimator's: one table for each of them."""
    ours, *others = dict.fromkeys(x.job.variant.label for of in runs.values() for x in of)
    return [_beside(ours, name, runs) for name in others]


def _beside(ours: str, other: str, runs: Mapping[str, Sequence[Result]]) -> Table:
    """One row a scene, medians over drives."""
    table = Table("drift over 1 m, %", ours, "worst", "°/m", "lost", other, "ratio", "lost")
    for column in table.columns[1:]:
        column.justify = "right"
    for scene, of_scene in runs.items():
        mine, theirs = (
            [x for x in of_scene if x.job.variant.label == name] for name in (ours, other)
        )
        drift, their_drift = ([x.drift_percent for x in of] for of in (mine, theirs))
        median, their_median = np.median(drift), np.median(their_drift)
        turn = np.median([x.rotation_deg_per_m for x in mine])
        lost, their_lost = (sum(x.lost_frames for x in of) for of in (mine, theirs))
        cells = (f"{x:.3f}" for x in (median, np.max(drift), turn))
        their_cells = (f"{their_median:.3f}", f"{median / their_median:.2f}", str(their_lost))
        table.add_row(scene, *cells, str(lost), *their_cells)
    return table


def bootstrap_interval(values: Array) -> tuple[float, float]:
    """Percentile interval of the median of (N,) values, N >= 1, at CONFIDENCE.

    With five values it is all but their range: a median needs drives, not segments.

    Source:
        Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13.
    """
    rng = np.random.default_rng(0)
    medians = np.median(rng.choice(values, (RESAMPLES, len(values))), axis=1)
    low, high = np.quantile(medians, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def accuracy_table(title: str, runs: Sequence[Result]) -> Table:
    """Lay out every figure of every estimator: median over drives, worst, interval."""
    names = list(dict.fromkeys(x.job.variant.label for x in runs))
    drives = len(runs) // len(names)
    path_m = sum(x.path_m for x in runs) / len(names)
    title = f"{title}: {drives} {'drive' if drives == 1 else 'drives'}, {path_m:.1f} m in all"
    table = Table("estimator", "figure", "median", "worst", "95 %", title=title)
    for column in table.columns[2:]:
        column.justify = "right"
    for name in names:
        mine = [x for x in runs if x.job.variant.label == name]
        for k, figure in enumerate(FIGURES):
            values = [_at(x.score.as_json() if x.score else None, figure.key) for x in mine]
            table.add_row(name if k == 0 else "", figure.label, *_spread(values, figure.digits))
        lost = [x.lost_frames for x in mine]
        total = f"{sum(lost)} of {sum(len(x.frames) for x in mine)}"
        table.add_row("", "frames lost", total, str(max(lost)), "", end_section=True)
    return table


def _spread(values: list[float | None], digits: int) -> tuple[str, str, str]:
    known = np.array([x for x in values if x is not None])
    if len(known) < len(values):
        return "–", "–", "–"
    median, worst = f"{np.median(known):.{digits}f}", f"{known.max():.{digits}f}"
    if len(known) == 1:
        return median, worst, "–"
    low, high = bootstrap_interval(known)
    return median, worst, f"{low:.{digits}f}–{high:.{digits}f}"


def _at(content: Any, key: tuple[str, ...]) -> float | None:
    for part in key:
        content = None if content is None else content[part]
    return content


def write_scores(out: Path, runs: Mapping[str, Sequence[Result]]) -> None:
    """Write the scores of all runs as JSON, by scene."""
    content = {
        name: [
            {"seed": x.job.recording.seed, "estimator": x.job.variant.label,
             "score": x.score.as_json() if x.score else None}
            for x in of_scene
        ]
        for name, of_scene in runs.items()
    }  # fmt: skip
    write_text(out, json.dumps(content, indent=1) + "\n")
