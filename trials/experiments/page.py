"""The page of all experiments, as Markdown: verdicts first, then each with its figure."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from trials.experiments.experiment import TableOf
from trials.experiments.record import Record
from vo.contract.files import write_text

INTRODUCTION = """# The thesis' claims, tested

The thesis that this estimator follows drew its conclusions by eye, from camera data without a
reference. Here each claim is tested where the truth is known. `driftyard experiment all` makes the
recordings, runs the variants, draws the figures and writes this page; an interval after a figure is
at 95 %, over drives (Student's t; ratios of paired drives through their logarithms).
"""


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
    parts = [INTRODUCTION, markdown_table(summary)]
    parts += [_section(record, pictures) for record in records]
    return "\n".join(parts)


def _heading(record: Record) -> str:
    return f"{record.id}. {record.title}"


def _anchor(record: Record) -> str:
    """As renderers of Markdown make it from the heading."""
    kept = (c for c in _heading(record).lower().replace(" ", "-") if c.isalnum() or c == "-")
    return "".join(kept)


def _section(record: Record, pictures: str) -> str:
    seeds = ", ".join(map(str, record.seeds))
    return f"""
## {_heading(record)}

*{record.claim}* (thesis, {record.source})

{record.setup} Seeds {seeds}.

**It {record.verdict.value}.** {record.sentence}

![{record.title}]({pictures}/{record.figure})

{record.caption}

{markdown_table(record.table)}"""


def markdown_table(table: TableOf) -> str:
    """Lay out a table for Markdown: text to the left, the rest to the right."""
    head = " | ".join(table.columns)
    rule = "|".join("---" if k == 0 else "---:" for k in range(len(table.columns)))
    rows = [" | ".join(row) for row in table.rows]
    return "\n".join([f"| {head} |", f"|{rule}|", *(f"| {row} |" for row in rows), ""])
