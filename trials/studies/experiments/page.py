"""The page of all experiments, as Markdown and as HTML: verdicts first, then each figure."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from trials.report.study import Mood, Part, write_study
from trials.studies.experiments.experiment import TableOf, Verdict
from trials.studies.experiments.record import Record
from vo.contract.files import write_text

TITLE = "The thesis' claims, tested"
INTRODUCTION = """The thesis that this estimator follows drew its conclusions by eye, from camera
data without a reference. Here each claim is tested where the truth is known. `driftyard experiment
all` makes the recordings, runs the variants, draws the figures and writes this page. An interval
after a figure is at 95 %, over drives (Student's t, cut off where no value can be; ratios of paired
drives by their logarithms).
"""

FIGURES = "0123456789-–"
"""What a cell with a figure, or with none to show, begins with."""

MOODS: dict[Verdict, Mood] = {
    Verdict.HOLDS: "good",
    Verdict.PARTLY: "mixed",
    Verdict.FAILS: "bad",
    Verdict.OPEN: "open",
}


def write_html(records: Sequence[Record], folder: Path, out: Path) -> None:
    """Write all records as one HTML page; their figures and data are in a folder."""
    parts = [
        Part(
            id=r.id,
            title=r.title,
            claim=r.claim,
            source=f"thesis, {r.source}",
            setup=_setup(r),
            verdict=r.verdict.value,
            mood=MOODS[r.verdict],
            sentence=r.sentence,
            figure=folder / r.figure,
            caption=r.caption,
            data=tuple(folder / name for name in r.data),
            columns=r.table.columns,
            rows=r.table.rows,
        )
        for r in records
    ]
    write_study(TITLE, INTRODUCTION, parts, out)


def write_page(records: Sequence[Record], folder: Path, page: Path) -> None:
    """Write the page, and copy the figures into `images/experiments` beside it.

    Args:
        records: In the order of the page.
        folder: Where their figures are.
        page: Markdown file to write.
    """
    pictures = page.parent / "images" / "experiments"
    pictures.mkdir(parents=True, exist_ok=True)
    for record in records:
        shutil.copyfile(folder / record.figure, pictures / record.figure)
    write_text(page, page_text(records, "images/experiments"))


def page_text(records: Sequence[Record], pictures: str) -> str:
    """The page's Markdown; figures are looked for in a folder `pictures`."""
    summary = TableOf(
        ("", "claim", "here it"),
        tuple((f"[{r.id}](#{_anchor(r)})", r.claim, f"**{r.verdict.value}**") for r in records),
    )
    parts = [f"# {TITLE}\n\n{INTRODUCTION}", markdown_table(summary)]
    parts += [_section(record, pictures) for record in records]
    return "\n".join(parts)


def _heading(record: Record) -> str:
    return f"{record.id}. {record.title}"


def _anchor(record: Record) -> str:
    """As renderers of Markdown make it from the heading."""
    kept = (c for c in _heading(record).lower().replace(" ", "-") if c.isalnum() or c == "-")
    return "".join(kept)


def _setup(record: Record) -> str:
    return f"{record.setup} Seeds {', '.join(map(str, record.seeds))}, or the first of them."


def _section(record: Record, pictures: str) -> str:
    return f"""
## {_heading(record)}

*{record.claim}* (thesis, {record.source})

{_setup(record)}

**It {record.verdict.value}.** {record.sentence}

![{record.title}]({pictures}/{record.figure})

{record.caption}

{markdown_table(record.table)}"""


def markdown_table(table: TableOf) -> str:
    """Lay out a table for Markdown: text to the left, figures to the right."""
    head = " | ".join(table.columns)
    cells = zip(*table.rows, strict=True)
    rule = "|".join("---:" if all(x[:1] in FIGURES for x in column) else "---" for column in cells)
    rows = [" | ".join(row) for row in table.rows]
    return "\n".join([f"| {head} |", f"|{rule}|", *(f"| {row} |" for row in rows), ""])
