"""Report of all experiments, as Markdown and as HTML: verdicts first, then every figure."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from trials.report.html import data_uri, write_html
from trials.report.tables import markdown_table, numeric_columns
from trials.studies.experiments.base import Record, Verdict
from vo.contract.files import write_text

TITLE = "The claims of the thesis, tested"
INTRODUCTION = """The thesis that this estimator follows judged its results by visual inspection of
camera data without ground truth. Here each claim is tested against exact ground truth.
`driftyard experiment all` makes the recordings, by the camera that each section names (`--camera`),
runs the variants, draws the figures and writes this page. Intervals are 95 % confidence intervals
over drives (Student's t, clipped to the possible range; ratios of paired drives are averaged as
logarithms).
"""

MOODS = dict(zip(Verdict, ("good", "mixed", "bad", "open"), strict=True))
"""Verdict to its class in the style sheet."""


def write_html_page(records: Sequence[Record], folder: Path, out: Path) -> None:
    """Write all records as one HTML page, with the figures and data of a folder inside it."""
    parts = [
        {
            **vars(record),
            "setup": _setup(record),
            "mood": MOODS[record.verdict],
            "figure_uri": data_uri((folder / record.figure).read_bytes(), "image/png"),
            "data": [(x, data_uri((folder / x).read_bytes(), "text/csv")) for x in record.data],
            "numeric": numeric_columns(record.table.rows),
        }
        for record in records
    ]
    write_html(out, "study.html.j2", title=TITLE, introduction=INTRODUCTION, parts=parts)


def write_page(records: Sequence[Record], folder: Path, page: Path) -> None:
    """Write a Markdown page, and copy the figures into `images/experiments` beside it."""
    pictures = page.parent / "images" / "experiments"
    pictures.mkdir(parents=True, exist_ok=True)
    for record in records:
        shutil.copyfile(folder / record.figure, pictures / record.figure)
    write_text(page, page_text(records, "images/experiments"))


def page_text(records: Sequence[Record], pictures: str) -> str:
    """Return the page as Markdown; the folder `pictures` holds the figures."""
    claims = [(f"[{r.id}](#{_anchor(r)})", r.claim, f"**{r.verdict.value}**") for r in records]
    summary = markdown_table(("", "claim", "result"), claims)
    sections = (_section(x, pictures) for x in records)
    return "\n".join([f"# {TITLE}\n\n{INTRODUCTION}", f"{summary}\n", *sections])


def _heading(record: Record) -> str:
    return f"{record.id}. {record.title}"


def _anchor(record: Record) -> str:
    """Return the anchor that Markdown renderers derive from the heading."""
    kept = (c for c in _heading(record).lower().replace(" ", "-") if c.isalnum() or c == "-")
    return "".join(kept)


def _setup(record: Record) -> str:
    seeds = ", ".join(map(str, record.seeds))
    return f"{record.setup} Seeds {seeds} or the first of these; camera `{record.camera}`."


def _section(record: Record, pictures: str) -> str:
    return f"""
## {_heading(record)}

*{record.claim}* (thesis, {record.source})

{_setup(record)}

**The claim {record.verdict.value}.** {record.sentence}

![{record.title}]({pictures}/{record.figure})

{record.caption}

{markdown_table(record.table.columns, record.table.rows, align_numbers=True)}
"""
