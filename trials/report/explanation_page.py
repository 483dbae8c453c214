"""Explanations of drift as text and tables, in the terminal and as a Markdown page."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from trials.diagnosis.attribution import REMAINDER, summarize
from trials.diagnosis.combinations import Subject
from trials.diagnosis.explanation import MIN_ATTRIBUTED, Explanation, Finding
from trials.evaluation import consistency
from trials.evaluation.intervals import Interval
from trials.report.explanation_figures import draw_figures
from trials.report.tables import markdown_table, write_csv
from vo.contract.files import write_text
from vo.contract.settings import given_values, value_at

Row = tuple[str, ...]
SHARE_HEAD = ("stage", "percentage points", "share, %")
BOUND_HEAD = (
    "noise of u, v, d, px", "bias of u, v, d, px", "error over 1 m, %", "bound, %", "ratio",
    "error at the end, mm", "bound, mm",
)  # fmt: skip
NEES_HEAD = (
    "status", "steps", "NEES of steps", "expected", "% inside 95 % ellipsoid", "NEES over 1 m",
    "NEES of poses", "expected",
)  # fmt: skip

TITLE = "# Where the drift comes from"
SHARE_TEXT = """\
## Contribution of each stage

Each stage is replaced by the ground truth of the labels, alone and in every combination with the
others, on the same drives. The share of a stage is the reduction of the drift by its ground truth,
averaged over all orders of replacement (Shapley value), so that the shares and the remainder add
up to the drift. **Prediction** is the start of the search for matches, **matching** which
landmarks are matched and their image positions, **stereo** the disparities of features, and
**inliers** the selection of inliers. The remainder, with ground truth in all of them, is not
separated: it consists of refinement and of the choice of features. A negative share means that the
errors of a stage compensate those of others: its ground truth alone increases the drift. Intervals
(95 %) are from a bootstrap over drives and over blocks of their paths.
"""
BOUND_TEXT = """\
## Cramér–Rao bound

The Cramér–Rao bound for the same tracks is the smallest error of any unbiased estimator that
observes these landmarks in these frames with independent errors of the measured size. Values are
root mean squares over all segments of the drives; if frames were lost, over the longest sequence of
frames that tracks connect. The noise is the standard deviation of a Gaussian with the same Fisher
information as a Student t distribution fitted to the residuals. The error exceeds the bound because
errors are biased or correlated, and because each pose is estimated before the next frame is
available.
"""
NEES_TEXT = """\
## Consistency of the covariances

The normalised estimation error squared (NEES) is the squared error in units of the covariance that
the estimator gave, with six degrees of freedom: its mean is 6 if the covariance is correct and
larger if the estimator is overconfident. `expected` is the 95 % interval of the mean for correct
covariances (of steps, if they were independent; of poses, one for each drive). The covariance over
1 m is that of the first step, and the drift afterwards (conventions.md).
"""


def terminal_report(explanations: Sequence[Explanation]) -> Iterator[Table | str]:
    """Yield sentences and tables for a terminal of 80 columns."""
    yield escape(describe_subject(explanations[0].subject, explanations[0].settings))
    for x in explanations:
        yield f"{x.name}: {describe(x)}"
        if x.attribution:
            yield _table(f"{x.name}: attribution of the drift", SHARE_HEAD, share_rows(x))
        yield f"{x.name}: Cramér–Rao bound"
        yield "\n".join(f"  {name}: {y}" for name, y in zip(BOUND_HEAD, bound_row(x), strict=True))
        if x.nees:
            yield _table(f"{x.name}: consistency of the covariances", NEES_HEAD, nees_rows(x))


def validation_table(findings: Sequence[Finding], subject: Subject) -> Table:
    """Tabulate how much of the drift of each injected error is attributed to its stage.

    The title names the estimator and its settings as they were given.
    """
    head = ("injected error", "drift without, %", "drift with, %", "stage", "attributed",
            f"at least {MIN_ATTRIBUTED:.0%}")  # fmt: skip
    rows = [
        (x.name, f"{x.before.drift.value:.3f}", f"{x.after.drift.value:.3f}", x.stage,
         f"{x.attributed:.0%}", "yes" if x.attributed >= MIN_ATTRIBUTED else "NO")
        for x in findings
    ]  # fmt: skip
    return _table(escape(describe_subject(subject, {})), head, rows)


def describe_subject(subject: Subject, settings: Mapping[str, Any]) -> str:
    """Name the estimator and the settings that differ from its defaults, as they were run."""
    choice = subject.estimator
    given = given_values(choice.config, choice.overrides)
    resolved = {key: _resolved(settings, key, value) for key, value in given.items()}
    changed = ", ".join(f"`{key}={json.dumps(value)}`" for key, value in resolved.items())
    words = f"{changed} and otherwise its default settings" if changed else "its default settings"
    noise = f", with noise of {subject.noise_px:g} px added to the ground truth"
    return f"estimator `{choice.name}` with {words}{noise if subject.noise_px else ''}"


def _resolved(settings: Mapping[str, Any], key: str, value: Any) -> Any:
    """Return a setting as it was run, or as it was given if the estimator has no such key."""
    with suppress(KeyError, TypeError):
        return value_at(settings, key)
    return value


def _origin(explanations: Sequence[Explanation]) -> str:
    """State what the results are of."""
    datasets = sum(len(x.datasets) for x in explanations)
    plural = "s" if datasets > 1 else ""
    return fill(
        "This page is written by `driftyard explain`. All results are of the "
        f"{describe_subject(explanations[0].subject, explanations[0].settings)}, on {datasets} "
        f"dataset{plural}.",
        100, break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def describe(x: Explanation) -> str:
    """Describe the drift of a scene and its causes in a few sentences."""
    percent = np.mean(x.drift) if x.attribution is None else x.attribution.drift.value
    drift = f"{percent:.3f} % of drift over 1 m"
    if x.attribution is None:
        return f"{drift}; the estimator has no hooks, so no stage can be separated."
    kept = f" Could not be separated: {', '.join(x.inseparable)}." if x.inseparable else ""
    lost = f" {x.lost} frames were lost over all runs." if x.lost else ""
    return f"{drift}. {summarize(x.attribution)}{kept}{lost}"


def share_rows(x: Explanation) -> list[Row]:
    """Return the whole drift and the share of each stage."""
    if x.attribution is None:
        return []
    rows: list[Row] = [("all", x.attribution.drift.text(3), "100")]
    for stage in x.attribution.shares:
        percent = Interval(*(100 * y for y in vars(stage.share).values())).text(0)
        rows.append((stage.stage, stage.drift.text(3), percent))
    return rows


def bound_row(x: Explanation) -> Row:
    """Return root mean squares over the drives of a scene, or the reason why there are none."""
    if not x.bounded:
        reasons = [y for y in x.bounds if isinstance(y, str)]
        return (*reasons[:1], *("–",) * (len(BOUND_HEAD) - len(reasons[:1])))

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean(np.square([getattr(y, name) for y in x.bounded]))))

    noise, bias = (
        " ".join(f"{v:.2f}" for v in np.mean([getattr(y, kind) for y in x.bounded], axis=0))
        for kind in ("noise_px", "bias_px")
    )
    error, bound = rms("over_1m_percent"), rms("bound_over_1m_percent")
    ends_mm = (1e3 * rms("end_m"), 1e3 * rms("bound_end_m"))
    return (noise, bias, f"{error:.3f}", f"{bound:.3f}", f"{error / bound:.1f}",
            *(f"{end:.1f}" for end in ends_mm))  # fmt: skip


def nees_rows(x: Explanation) -> list[Row]:
    """Return one row for each status."""
    return [
        (
            s.status,
            str(s.steps),
            f"{s.step:.1f}",
            _range(s.step_bounds),
            f"{100 * s.step_inside:.0f}",
            f"{s.over_1m:.1f}" if np.isfinite(s.over_1m) else "–",
            f"{s.absolute:.1f}",
            _range(s.absolute_bounds),
        )
        for s in consistency.summarize(x.nees)
    ]


def write_explanations(explanations: Sequence[Explanation], out: Path, page: Path) -> list[Path]:
    """Write figures (PNG), data (JSON, CSV) and the Markdown page; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    data, along = out / "explain.json", out / "explain.csv"
    content = json.dumps([x.as_json() for x in explanations])
    content = json.loads(content, parse_constant=lambda _: None)  # JSON has no NaN
    write_text(data, json.dumps(content, indent=1) + "\n")
    _write_shares(explanations, along)
    figures = draw_figures(explanations, out)
    links = {k: Path(os.path.relpath(v, page.parent)).as_posix() for k, v in figures.items()}
    write_text(page, _page(explanations, links))
    return [page, data, along, *figures.values()]


def _page(explanations: Sequence[Explanation], figures: Mapping[str, str]) -> str:
    parts = [
        TITLE,
        _origin(explanations),
        SHARE_TEXT,
        "\n".join(f"- **{x.name}**: {describe(x)}" for x in explanations),
    ]
    if "shares" in figures:
        parts += [
            f"![Drift and its shares, stage by stage]({figures['shares']})",
            _markdown(SHARE_HEAD, {x.name: share_rows(x) for x in explanations}),
            "Shares along the path (means over the drives; shares can be negative):",
            f"![Share of each stage along the path]({figures['path']})",
        ]
    parts += [BOUND_TEXT, _markdown(BOUND_HEAD, {x.name: [bound_row(x)] for x in explanations})]
    if "calibration" in figures:
        parts += [
            NEES_TEXT,
            _markdown(NEES_HEAD, {x.name: nees_rows(x) for x in explanations}),
            f"![Errors inside ellipsoids of given probability]({figures['calibration']})",
            "A curve below the dashed line indicates an overconfident estimator.",
        ]
    return "\n\n".join(x.rstrip("\n") for x in parts) + "\n"


def _write_shares(explanations: Sequence[Explanation], out: Path) -> None:
    """Write CSV: a row for each segment of each dataset, the share of each stage in %."""
    parts = [(x.name, x.attribution) for x in explanations if x.attribution]
    stages = dict.fromkeys(s.stage for _, x in parts for s in x.shares[:-1])
    names = [*stages, REMAINDER]
    rows: list[list[str]] = []
    for scene, x in parts:
        for dataset, (at_m, shares) in x.by_segment.items():
            for place, column in zip(at_m, shares.T, strict=True):
                by_name = {s.stage: f"{y:.5f}" for s, y in zip(x.shares, column, strict=True)}
                values = [by_name.get(name, "") for name in names]
                rows.append([scene, dataset, f"{place:.4f}", f"{column.sum():.5f}", *values])
    write_csv(out, ["scene", "dataset", "at_m", "drift_percent", *names], rows)


def _table(title: str, head: Row, rows: Sequence[Row]) -> Table:
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    wrapped = [
        fill(text, width, break_long_words=False) for text, width in zip(head, widths, strict=True)
    ]
    table = Table(*wrapped, title=title, title_justify="left", box=None, pad_edge=False)
    for row in rows:
        table.add_row(*row)
    return table


def _markdown(head: Row, rows_of: Mapping[str, Sequence[Row]]) -> str:
    """Lay out rows with the name of the scene before the first of each."""
    rows = [(x if k == 0 else "", *y) for x, some in rows_of.items() for k, y in enumerate(some)]
    return markdown_table(("scene", *head), rows)


def _range(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.1f} to {interval[1]:.1f}"
