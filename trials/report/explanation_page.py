"""An explanation in words and tables: in the terminal, and as a Markdown page with its figures."""

import csv
import io
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from trials.diagnosis.attribution import REST, sentence
from trials.diagnosis.bound import Bound
from trials.diagnosis.explanation import Explanation
from trials.evaluation.consistency import summary
from trials.report.explanation_figures import draw_calibration, draw_paths, draw_waterfalls
from vo.contract.files import write_text

Row = tuple[str, ...]
SHARE_HEAD = ("scene", "drift over 1 m, %", "stage", "points", "share, %")
BOUND_HEAD = (
    "scene", "noise u, v, d, px", "bias u, v, d, px", "error over 1 m, %", "bound, %", "ratio",
    "end, mm", "bound, mm",
)  # fmt: skip
NEES_HEAD = (
    "scene", "status", "steps", "NEES of steps", "if right", "in 95 % ellipsoid, %",
    "NEES over 1 m", "NEES of poses", "if right",
)  # fmt: skip
NAMES = ("scene", "stage", "status")

INTRODUCTION = """\
# Where the drift comes from

Written by `make explain`, that is `driftyard explain`; all figures are of the estimator with its
default settings, on drives that no parameter was chosen on.

## What each stage costs

Each stage is replaced by the truth of the labels, alone and together with each choice of the
others, on the same drives. A stage's share is what its truth takes off the drift, averaged over
all orders in which truths can be put in (Shapley value), so that the shares and what remains add
up. **Prediction** is where the search for matches starts, **matching** which landmarks are found
and where in the image, **stereo** the depth of features, **inliers** which matches are taken to be
right. What remains with all of them true is not separated: refinement, and which features there
are. A share below zero means that a stage's errors make up for another's: the truth in its place
alone makes the drift worse. Intervals (95 %) are of a bootstrap over drives and stretches of them.
"""
BOUND_TEXT = """\
## How near the bound it is

The Cramér–Rao bound for the same tracks: no unbiased estimator that sees these landmarks in these
frames, with independent errors of the size that the labels show, errs less. Root mean squares over
all metres of the drives; where frames were lost, of the longest stretch that tracks connect. The
noise is what a Student t distribution of the residuals is worth, as the standard deviation of a
Gaussian. What is lost beyond the bound is lost to errors that are
biased or go together, and to telling each pose before the next frame is seen.
"""
NEES_TEXT = """\
## Whether its covariances are right

NEES is the squared error in units of the covariance that the estimator gave, six degrees of
freedom: 6 on average where the covariance is right, more where it promises too much. `if right` is
where 95 % of such averages would fall (of steps, as if they were independent; of poses, one a
drive). The covariance over 1 m is what the pose's has grown by.
"""


def tables(explanations: Sequence[Explanation]) -> Iterator[Table | str]:
    """Tables and sentences for the terminal."""
    for x in explanations:
        yield f"{x.name}: {verdict(x)}"
    for head, rows in (
        (SHARE_HEAD, share_rows(explanations)),
        (BOUND_HEAD, bound_rows(explanations)),
        (NEES_HEAD, nees_rows(explanations)),
    ):
        table = Table(*head)
        for column in table.columns:
            column.no_wrap = column.header in NAMES  # a name cut short says nothing,
            column.overflow = "fold"  # a number even less
        for row in rows:
            table.add_row(*row)
        yield table


def verdict(x: Explanation) -> str:
    """One sentence on a scene; its drift is what the shares add up to, as in the table."""
    percent = np.mean(x.drift) if x.attribution is None else x.attribution.drift
    drift = f"{percent:.3f} % of drift over 1 m"
    if x.attribution is None:
        return f"{drift}; the estimator takes no hooks, so nothing can be separated."
    kept = f" Could not be separated: {', '.join(x.inseparable)}." if x.inseparable else ""
    lost = f" {x.lost} frames were lost over all runs." if x.lost else ""
    return f"{drift}. {sentence(x.attribution)}{kept}{lost}"


def share_rows(explanations: Sequence[Explanation]) -> list[Row]:
    """One row for each scene and stage."""
    rows: list[Row] = []
    for x in explanations:
        if not x.attribution:
            continue
        whole = _interval(x.attribution.drift, x.attribution.drift_interval, 3)
        for k, share in enumerate(x.attribution.shares):
            points = _interval(share.drift, share.drift_interval, 3)
            low, high = share.share_interval
            percent = _interval(100 * share.share, (100 * low, 100 * high), 0)
            rows.append((*((x.name, whole) if k == 0 else ("", "")), share.stage, points, percent))
    return rows


def bound_rows(explanations: Sequence[Explanation]) -> list[Row]:
    """One row for each scene, root mean squares over its drives."""
    return [_bound_row(x.name, x.bounded, [y for y in x.bounds if isinstance(y, str)])
            for x in explanations]  # fmt: skip


def nees_rows(explanations: Sequence[Explanation]) -> list[Row]:
    """One row for each scene and status."""
    rows: list[Row] = []
    for x in explanations:
        for k, s in enumerate(summary(x.nees)):
            rows.append(
                (
                    x.name if k == 0 else "",
                    s.status,
                    str(s.steps),
                    f"{s.step:.1f}",
                    _range(s.step_bounds),
                    f"{100 * s.step_inside:.0f}",
                    f"{s.over_1m:.1f}" if np.isfinite(s.over_1m) else "–",
                    f"{s.absolute:.1f}",
                    _range(s.absolute_bounds),
                )
            )
    return rows


def write_explanations(explanations: Sequence[Explanation], out: Path, page: Path) -> list[Path]:
    """Write figures, data and the page; returns what was written.

    Args:
        explanations: Of each scene.
        out: Folder of figures (PNG) and data (JSON, CSV).
        page: Markdown.
    """
    out.mkdir(parents=True, exist_ok=True)
    data, along = out / "explain.json", out / "explain.csv"
    content = [x.as_json() for x in explanations]
    write_text(data, json.dumps(_finite(content), indent=1) + "\n")
    write_text(along, _along_path(explanations))
    figures: dict[str, Path] = {}
    if any(x.attribution for x in explanations):
        figures["shares"], figures["path"] = out / "shares.png", out / "path.png"
        draw_waterfalls(explanations, figures["shares"])
        draw_paths(explanations, figures["path"])
    if any(x.nees for x in explanations):
        figures["calibration"] = out / "calibration.png"
        draw_calibration(explanations, figures["calibration"])
    links = {k: Path(os.path.relpath(v, page.parent)).as_posix() for k, v in figures.items()}
    write_text(page, _page(explanations, links))
    return [page, data, along, *figures.values()]


def _page(explanations: Sequence[Explanation], figures: dict[str, str]) -> str:
    parts = [INTRODUCTION, "\n".join(f"- **{x.name}**: {verdict(x)}" for x in explanations)]
    if "shares" in figures:
        parts += [
            f"![From the drift down to what remains, stage by stage]({figures['shares']})",
            _markdown(SHARE_HEAD, share_rows(explanations)),
            "Where on the route each stage costs it (means over the drives; stages can be below "
            "zero):",
            f"![Share of each stage along the path]({figures['path']})",
        ]
    parts += [BOUND_TEXT.rstrip(), _markdown(BOUND_HEAD, bound_rows(explanations))]
    if "calibration" in figures:
        parts += [
            NEES_TEXT.rstrip(),
            _markdown(NEES_HEAD, nees_rows(explanations)),
            f"![Errors inside the ellipsoids that should hold them]({figures['calibration']})",
            "A curve below the dashed line: the estimator believes itself too much.",
        ]
    return "\n\n".join(x.rstrip("\n") for x in parts) + "\n"


def _along_path(explanations: Sequence[Explanation]) -> str:
    """CSV: one row for each metre of each dataset, the share of each stage in % of its length."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    stages = list(dict.fromkeys(s.stage for x in explanations if x.attribution
                                for s in x.attribution.shares[:-1]))  # fmt: skip
    table.writerow(["scene", "dataset", "at_m", "drift_percent", *stages, REST])
    for x in explanations:
        if not x.attribution:
            continue
        names = [s.stage for s in x.attribution.shares]
        for dataset, (at_m, shares) in x.attribution.by_segment.items():
            for place, column in zip(at_m, shares.T, strict=True):
                by_name = dict(zip(names, column, strict=True))
                values = [f"{by_name[s]:.5f}" if s in by_name else "" for s in [*stages, REST]]
                table.writerow([x.name, dataset, f"{place:.4f}", f"{column.sum():.5f}", *values])
    return text.getvalue()


def _bound_row(name: str, bounds: Sequence[Bound], reasons: Sequence[str]) -> Row:
    if not bounds:
        return (name, *reasons[:1], *("–",) * (len(BOUND_HEAD) - 1 - len(reasons[:1])))

    def rms(values: Sequence[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    noise, bias = (
        " ".join(f"{v:.2f}" for v in np.mean([getattr(x.noise, kind) for x in bounds], axis=0))
        for kind in ("effective_px", "bias_px")
    )
    error, least = (
        rms([x.over_1m_percent for x in bounds]), rms([x.least_over_1m_percent for x in bounds])
    )  # fmt: skip
    end, least_end = rms([x.end_m for x in bounds]), rms([x.least_end_m for x in bounds])
    return (
        name, noise, bias, f"{error:.3f}", f"{least:.3f}", f"{error / least:.1f}",
        f"{1e3 * end:.1f}", f"{1e3 * least_end:.1f}",
    )  # fmt: skip


def _markdown(head: Row, rows: Sequence[Row]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _interval(value: float, interval: tuple[float, float], digits: int) -> str:
    low, high = interval
    if not np.isfinite(low):
        return f"{value:.{digits}f}"
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _range(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.1f} to {interval[1]:.1f}"


def _finite(content: object) -> object:
    """Replace NaN, which JSON has not, by null."""
    if isinstance(content, dict):
        return {k: _finite(v) for k, v in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(v) for v in content]
    return None if isinstance(content, float) and not np.isfinite(content) else content
